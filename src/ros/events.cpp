#include "ros/events.h"

#include <algorithm>
#include <cmath>

#include "ros/marker_style.h"

namespace constraint_sim {
namespace {

std::uint8_t kind_of(engine::EventKind kind) {
  switch (kind) {
    case engine::EventKind::kBroken:
      return Event::BROKEN;
    case engine::EventKind::kRopeTaut:
      return Event::ROPE_TAUT;
    case engine::EventKind::kRopeSlack:
      return Event::ROPE_SLACK;
    case engine::EventKind::kLimitReached:
      return Event::LIMIT_REACHED;
    case engine::EventKind::kLimitLeft:
      return Event::LIMIT_LEFT;
    case engine::EventKind::kSaturated:
      return Event::SATURATED;
    case engine::EventKind::kReleased:
      return Event::RELEASED;
    case engine::EventKind::kSlips:
      return Event::SLIPS;
    case engine::EventKind::kSticks:
      return Event::STICKS;
    case engine::EventKind::kContactBegan:
      return Event::CONTACT_BEGAN;
    case engine::EventKind::kContactEnded:
      return Event::CONTACT_ENDED;
    case engine::EventKind::kHit:
      return Event::HIT;
    case engine::EventKind::kHandedOver:
      return Event::HANDED_OVER;
    case engine::EventKind::kTakenBack:
      return Event::TAKEN_BACK;
  }
  return Event::FAILED;
}

bool is_of_island(engine::EventKind kind) {
  return kind == engine::EventKind::kHandedOver || kind == engine::EventKind::kTakenBack;
}

}  // namespace

EventTopic::EventTopic(ros::NodeHandle& private_handle, const Publishers& publishers)
    : publishers_(publishers), topic_(private_handle.advertise<Event>("events", 1000)) {}

void EventTopic::stepped(const World& world) {
  if (world.report().outcome.failed) return;  // passed() reports the failure
  if (topic_.getNumSubscribers() == 0) {
    has_looked_ = false;
    return;
  }
  tell_of_listed(world);
  tell_of_joints(world);
  tell_of_contacts(world);
  has_looked_ = true;
}

void EventTopic::edited(const World& world) {
  if (!has_looked_) return;
  joints_.clear();
  for (const engine::JointId id : world.joint_ids()) joints_[id.value] = look_at(world, id);
  // A removed body ends no contact: no event is published for it.
  std::set<std::uint32_t> bodies = {engine::kWorldBody.value};
  for (const engine::BodyId id : world.body_ids()) bodies.insert(id.value);
  for (auto contact = contacts_.begin(); contact != contacts_.end();) {
    const auto& [a, b] = contact->first;
    const bool is_there = bodies.count(a) > 0 && bodies.count(b) > 0;
    contact = is_there ? std::next(contact) : contacts_.erase(contact);
  }
}

void EventTopic::passed(const World& world, const Stepper& stepper) {
  if (stepper.has_failed() == has_failed_) return;
  has_failed_ = stepper.has_failed();
  if (!has_failed_ || topic_.getNumSubscribers() == 0) return;
  std::vector<std::string> names;
  if (const auto joint = world.failed_joint()) names.push_back(world.joint(*joint).name);
  if (const auto body = world.report().outcome.failed_body) names.push_back(world.body(*body).name);
  publish(world, Event::FAILED, std::move(names));
}

EventTopic::JointSeen EventTopic::look_at(const World& world, engine::JointId id) {
  const engine::Joint& joint = world.joint(id);
  const engine::JointState& state = world.joint_state(id);
  const bool acts = joint.enabled && !state.broken;
  return {state.broken, state.saturated, acts && is_rope(joint) && !is_slack(joint, state)};
}

// Publishes events that the engine lists, with the moment within the tick.
void EventTopic::tell_of_listed(const World& world) {
  listed_joints_.clear();
  listed_pairs_.clear();
  for (const engine::Event& event : world.events()) {
    std::vector<std::string> names;
    if (event.joint) {
      listed_joints_.insert(event.joint->value);
      names = {world.joint(*event.joint).name};
    } else {
      names = {world.body(event.body_a).name};
      if (event.body_b != event.body_a) names.push_back(world.body(event.body_b).name);
      if (!is_of_island(event.kind))
        listed_pairs_.insert(std::minmax({event.body_a.value, event.body_b.value}));
    }
    publish(world, kind_of(event.kind), std::move(names), event.impulse, event.time);
  }
}

void EventTopic::tell_of_joints(const World& world) {
  for (const engine::JointId id : world.joint_ids()) {
    const JointSeen now = look_at(world, id);
    const auto [seen, is_new] = joints_.try_emplace(id.value, now);
    const JointSeen before = std::exchange(seen->second, now);
    if (!has_looked_ || is_new || listed_joints_.count(id.value) > 0) continue;
    const std::string& name = world.joint(id).name;
    const double impulse = std::abs(world.joint_state(id).force) * world.options().time_step;
    if (now.broken && !before.broken) publish(world, Event::BROKEN, {name}, impulse);
    if (now.saturated != before.saturated)
      publish(world, now.saturated ? Event::SATURATED : Event::RELEASED, {name});
    if (now.broken || now.taut == before.taut) continue;
    publish(world, now.taut ? Event::ROPE_TAUT : Event::ROPE_SLACK, {name},
            now.taut ? impulse : 0.0);
  }
}

EventTopic::Contacts EventTopic::contacts_of(const World& world) {
  Contacts contacts;
  for (const engine::Contact& contact : world.contacts()) {
    ContactSeen& seen = contacts[std::minmax({contact.body_a.value, contact.body_b.value})];
    if (seen.name_a.empty()) {
      seen.name_a = world.body(contact.body_a).name;
      seen.name_b = world.body(contact.body_b).name;
    }
    seen.force += contact.normal_force;
  }
  return contacts;
}

void EventTopic::tell_of_contacts(const World& world) {
  const Contacts before = std::exchange(contacts_, contacts_of(world));
  if (!has_looked_) return;
  for (const auto& [pair, contact] : contacts_)
    if (before.count(pair) == 0 && listed_pairs_.count(pair) == 0)
      publish(world, Event::CONTACT_BEGAN, {contact.name_a, contact.name_b},
              contact.force * world.options().time_step);
  for (const auto& [pair, contact] : before)
    if (contacts_.count(pair) == 0 && listed_pairs_.count(pair) == 0)
      publish(world, Event::CONTACT_ENDED, {contact.name_a, contact.name_b});
}

void EventTopic::publish(const World& world, std::uint8_t kind, std::vector<std::string> names,
                         double impulse) {
  publish(world, kind, std::move(names), impulse, world.time());
}

void EventTopic::publish(const World& world, std::uint8_t kind, std::vector<std::string> names,
                         double impulse, double time) {
  Event message;
  message.header.stamp = publishers_.stamp(world);
  message.header.frame_id = publishers_.world_frame();
  message.kind = kind;
  message.names = std::move(names);
  message.time = time;
  message.impulse = impulse;
  topic_.publish(message);
}

}  // namespace constraint_sim
