#include "ros/edit_log.h"

#include "constraint_sim/engine/snapshot.h"
#include "ros/time_conversions.h"

namespace constraint_sim {
namespace {

constexpr std::uint32_t kQueue = 100000;  // records: one that is dropped shows in the numbers

}  // namespace

EditLog::EditLog(ros::NodeHandle& private_handle)
    : topic_(private_handle.advertise<EditRecord>(
          "edit_log", kQueue,
          [this](const ros::SingleSubscriberPublisher&) { newcomer_ = true; })) {}

void EditLog::drive(World* world, const std::function<void()>& drive) {
  if (!is_wanted() || newcomer_) return drive();
  const std::uint64_t before = world->state_hash();
  drive();
  if (world->state_hash() == before) return;
  publish("", {}, *world, before);
  record_world(*world);
}

void EditLog::edited(const Stepper& stepper, const World& world) {
  if (!is_accounted_for(stepper)) record_world(world);
  accounted_for_ = stepper.edits();
}

void EditLog::stepped(const World& world) {
  if (!is_wanted() || newcomer_) return;
  if (world.report().failed)
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
  if (is_wanted()) publish(service, std::move(request), world, world.state_hash());
}

void EditLog::publish(const char* service, std::vector<std::uint8_t> request, const World& world,
                      std::uint64_t hash) {
  EditRecord record;
  record.header.stamp = time_from_seconds(world.time());
  record.number = ++number_;
  record.step = world.step_count();
  record.service = service;
  record.request = std::move(request);
  record.state_hash = hash;
  topic_.publish(record);
}

}  // namespace constraint_sim
