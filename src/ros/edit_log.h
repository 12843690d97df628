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

/// The topic edit_log: every edit that took effect, with the hash of the world after it, while
/// there is a subscriber. A recorded log can be replayed. It begins for each subscriber with the
/// present world. An edit that no call recorded is recorded as the resulting world. Beyond
/// kMostBytes in its queue a subscriber is disconnected and begins anew. Stepping thread only.
class EditLog {
 public:
  /// Steps after which the hash is published even without an edit.
  static constexpr std::uint64_t kCheckEvery = 100;

  /// Length of the queue of a subscriber. A dropped record shows as a gap in the numbers.
  static constexpr std::uint32_t kMostRecords = 100000;
  /// Size of the last records beyond which subscribers are disconnected [bytes].
  static constexpr std::size_t kMostBytes = std::size_t{256} << 20;

  explicit EditLog(const ros::NodeHandle& private_handle);

  /// Records a request at the end of the stepper's edit that carried it out.
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
  /// Records the number of steps before an edit that resets it.
  void check(const Stepper& stepper, const World& world) {
    if (is_accounted_for(stepper)) publish("", {}, world);
  }
  /// Records the whole world after an edit that replaced it.
  void record_replaced(const Stepper& stepper, const World& world) {
    record_world(world);
    accounted_for_ = stepper.edits() + 1;
  }

  /// Calls `drive` before a step, and records the changes that it makes.
  void drive(World* world, const std::function<void(Driver*)>& drive);
  /// Calls `drive` within an edit of the stepper. Records the hash where nothing changed.
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
  std::deque<std::size_t> sizes_;      // sizes of the last records [bytes]
  std::size_t bytes_ = 0;              // sum of sizes_
  std::atomic<bool> newcomer_{false};  // a new subscriber has connected
  std::uint64_t accounted_for_ = 0;    // number of the stepper's edits recorded so far
  std::uint64_t number_ = 0;
};

}  // namespace constraint_sim
