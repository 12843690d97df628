#include "ros/edit_log.h"

#include <ros/console.h>

#include "constraint_sim/engine/snapshot.h"
#include "ros/edits.h"
#include "ros/time_conversions.h"

namespace constraint_sim {

EditLog::EditLog(const ros::NodeHandle& private_handle) : handle_(private_handle) { advertise(); }

void EditLog::advertise() {
  topic_ = handle_.advertise<EditRecord>(
      "edit_log", kMostRecords,
      [this](const ros::SingleSubscriberPublisher&) { newcomer_ = true; });
}

void EditLog::drive(World* world, const std::function<void(Driver*)>& drive) {
  DriveChanges changes;
  Driver driver(world, is_wanted() && !newcomer_ ? &changes : nullptr);
  drive(&driver);
  if (!changes.empty()) publish(kDriveRecord, bytes_of(changes), *world);
}

void EditLog::record_driven(const Stepper& stepper, World* world,
                            const std::function<void(Driver*)>& drive) {
  DriveChanges changes;
  Driver driver(world, &changes);
  drive(&driver);
  if (!is_accounted_for(stepper))
    record_world(*world);
  else if (changes.empty())
    publish("", {}, *world);
  else
    publish(kDriveRecord, bytes_of(changes), *world);
  accounted_for_ = stepper.edits() + 1;
}

void EditLog::edited(const Stepper& stepper, const World& world) {
  if (!is_accounted_for(stepper)) record_world(world);
  accounted_for_ = stepper.edits();
}

void EditLog::stepped(const World& world) {
  if (!is_wanted() || newcomer_) return;
  if (world.report().outcome.failed)
    publish("failed_step", {}, world);
  else if (world.step_count() % kCheckEvery == 0)
    publish("", {}, world);
}

void EditLog::passed(const World& world) {
  if (newcomer_) record_world(world);
}

void EditLog::record_world(const World& world) {
  newcomer_ = false;
  if (!is_wanted()) return;
  const std::string bytes = engine::write_snapshot(world);
  publish("snapshot", {bytes.begin(), bytes.end()}, world);
}

void EditLog::publish(const char* service, std::vector<std::uint8_t> request, const World& world) {
  if (!is_wanted()) return;
  EditRecord record;
  record.header.stamp = time_from_seconds(world.time());
  record.number = ++number_;
  record.step = world.step_count();
  record.service = service;
  record.request = std::move(request);
  record.state_hash = world.state_hash();
  topic_.publish(record);
  bound_waiting(ros::serialization::serializationLength(record));
}

// Disconnects a subscriber whose queue exceeds kMostBytes. roscpp bounds queues by the number of
// messages only and does not report their size, so the last kMostRecords are taken as queued.
void EditLog::bound_waiting(std::size_t bytes) {
  sizes_.push_back(bytes);
  bytes_ += bytes;
  if (sizes_.size() > kMostRecords) {
    bytes_ -= sizes_.front();
    sizes_.pop_front();
  }
  if (bytes_ <= kMostBytes || sizes_.size() == 1) return;
  ROS_WARN(
      "edit_log: %zu MiB of records may be waiting; its listeners are disconnected, and begin "
      "anew with the world as it is",
      bytes_ >> 20);
  topic_.shutdown();
  sizes_.clear();
  bytes_ = 0;
  advertise();
}

}  // namespace constraint_sim
