#pragma once

#include <constraint_sim/EditRecord.h>
#include <ros/node_handle.h>
#include <ros/publisher.h>
#include <ros/serialization.h>

#include <atomic>
#include <cstdint>
#include <functional>
#include <string>
#include <utility>
#include <vector>

#include "constraint_sim/engine/world.h"
#include "sim/stepper.h"

namespace constraint_sim {

/// The topic edit_log: every edit that took effect with the hash of the world after it, while
/// somebody listens; a recorded one can be replayed. It begins for each listener with the world as
/// it is. An edit that nobody has recorded is recorded as the world that it led to. On the stepping
/// thread.
class EditLog {
 public:
  /// Steps after which the hash of the world is told even where nobody edits it.
  static constexpr std::uint64_t kCheckEvery = 100;

  explicit EditLog(ros::NodeHandle& private_handle);

  /// Within the edit of the stepper that did what the request asks for, at its end.
  template <class Request>
  void record(const Stepper& stepper, const char* service, const Request& request,
              const World& world) {
    if (is_accounted_for(stepper)) {
      std::vector<std::uint8_t> bytes(ros::serialization::serializationLength(request));
      ros::serialization::OStream stream(bytes.data(), static_cast<std::uint32_t>(bytes.size()));
      ros::serialization::serialize(stream, request);
      publish(service, std::move(bytes), world);
    } else {
      record_world(world);
    }
    accounted_for_ = stepper.edits() + 1;
  }
  /// Before an edit that counts steps anew: how many there were.
  void check(const Stepper& stepper, const World& world) {
    if (is_accounted_for(stepper)) publish("", {}, world);
  }
  /// The same as record() of an edit that replaced the world.
  void record_replaced(const Stepper& stepper, const World& world) {
    record_world(world);
    accounted_for_ = stepper.edits() + 1;
  }

  /// Does what drives bodies and joints before a step. Where that changes the world it is recorded
  /// as the hash before it and the world that it led to.
  void drive(World* world, const std::function<void()>& drive);

  void edited(const Stepper& stepper, const World& world);
  void stepped(const World& world);
  void passed(const World& world);

 private:
  bool is_wanted() const { return topic_.getNumSubscribers() > 0; }
  bool is_accounted_for(const Stepper& stepper) const {
    return !newcomer_ && accounted_for_ == stepper.edits();
  }
  void record_world(const World& world);
  void publish(const char* service, std::vector<std::uint8_t> request, const World& world);
  void publish(const char* service, std::vector<std::uint8_t> request, const World& world,
               std::uint64_t hash);

  ros::Publisher topic_;
  std::atomic<bool> newcomer_{false};  // somebody has just subscribed
  std::uint64_t accounted_for_ = 0;    // edits of the stepper
  std::uint64_t number_ = 0;
};

}  // namespace constraint_sim
