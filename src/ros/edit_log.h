#pragma once

#include <constraint_sim/EditRecord.h>
#include <ros/node_handle.h>
#include <ros/publisher.h>
#include <ros/serialization.h>

#include <atomic>
#include <cstddef>
#include <cstdint>
#include <deque>
#include <functional>
#include <string>
#include <utility>
#include <vector>

#include "constraint_sim/engine/world.h"
#include "sim/drive_changes.h"
#include "sim/stepper.h"

namespace constraint_sim {

/// The topic edit_log: every edit that took effect with the hash of the world after it, while
/// somebody listens; a recorded one can be replayed. It begins for each listener with the world as
/// it is. An edit that nobody has recorded is recorded as the world that it led to. What a listener
/// that does not read keeps waiting is bounded: beyond kMostBytes it is disconnected and begins
/// anew. On the stepping thread.
class EditLog {
 public:
  /// Steps after which the hash of the world is told even where nobody edits it.
  static constexpr std::uint64_t kCheckEvery = 100;

  /// Records that may wait for a listener: one that is dropped shows in the numbers.
  static constexpr std::uint32_t kMostRecords = 100000;
  /// [bytes] of so many of the last records.
  static constexpr std::size_t kMostBytes = std::size_t{256} << 20;

  explicit EditLog(const ros::NodeHandle& private_handle);

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

  /// Does what drives bodies and joints before a step, and records the changes that it makes.
  void drive(World* world, const std::function<void(Driver*)>& drive);
  /// The same within an edit of the stepper; where nothing is changed, the hash is recorded.
  void record_driven(const Stepper& stepper, World* world,
                     const std::function<void(Driver*)>& drive);

  void edited(const Stepper& stepper, const World& world);
  void stepped(const World& world);
  void passed(const World& world);

 private:
  bool is_wanted() const { return topic_.getNumSubscribers() > 0; }
  bool is_accounted_for(const Stepper& stepper) const {
    return !newcomer_ && accounted_for_ == stepper.edits();
  }
  void advertise();
  void bound_waiting(std::size_t bytes);
  void record_world(const World& world);
  void publish(const char* service, std::vector<std::uint8_t> request, const World& world);

  ros::NodeHandle handle_;
  ros::Publisher topic_;
  std::deque<std::size_t> sizes_;      // [bytes] of the last records
  std::size_t bytes_ = 0;              // of all of these
  std::atomic<bool> newcomer_{false};  // somebody has just subscribed
  std::uint64_t accounted_for_ = 0;    // edits of the stepper
  std::uint64_t number_ = 0;
};

}  // namespace constraint_sim
