// Functions of World that concern no single body or joint: copies, options, time, reset.
// All files of this folder check everything first, and change data only when nothing can fail.

#include <algorithm>
#include <cmath>

#include "engine/edits/issue_id.h"
#include "engine/edits/joint_edits.h"
#include "engine/islands/motion_bounds.h"
#include "engine/math/list.h"
#include "engine/math/numbers.h"
#include "engine/model/validate.h"
#include "engine/world/next_islands.h"
#include "engine/world/world_impl.h"

namespace constraint_sim::engine {

World::World(const WorldOptions& options) : impl_(std::make_unique<Impl>()) {
  validate(options);
  impl_->options = options;
  Body world;
  world.name = "world";
  world.type = BodyType::kStatic;
  world.no_collision = true;
  impl_->bodies.push_back(world);
  impl_->states.push_back(world.state);
  impl_->masses.emplace_back();
  impl_->body_ids.push_back(kWorldBody);
  impl_->corrections.push_back(Twist::Zero());
  impl_->asleep.push_back(false);
  impl_->body_by_name.emplace(world.name, kWorldBody);
}

World::World(const World& other) : impl_(std::make_unique<Impl>(*other.impl_)) {}
World::World(World&&) noexcept = default;
World& World::operator=(const World& other) {
  if (impl_)
    *impl_ = *other.impl_;  // reuses allocated memory
  else
    impl_ = std::make_unique<Impl>(*other.impl_);
  return *this;
}
World& World::operator=(World&&) noexcept = default;
World::~World() = default;

void World::take_snapshot(World* snapshot) const {
  const Impl& from = *impl_;
  if (snapshot == this) return;
  if (from.edits.answers()) {  // only snapshots have answers
    *snapshot = *this;
    return;
  }
  if (!snapshot->impl_ || !snapshot->impl_->edits.answers()) *snapshot = World();
  Impl& to = *snapshot->impl_;
  if (!to.edits.has_model_of(from.edits)) static_cast<Model&>(to) = from;
  to.joints_of_bodies = {};
  static_cast<State&>(to) = from;
  to.report = from.report;
  if (from.report.outcome.failure == Failure::kCustom) {
    to.failed_joint = from.failed_joint;
    to.failed_why = from.failed_why;
  }
  to.contacts = from.contacts;
  to.resting_contact_count = from.resting_contact_count;
  to.events = from.events;
  to.monitors.set_unclosed(from.monitors.unclosed());
  to.sleep.continue_from(from.sleep.has_new_waking());
  SnapshotAnswers* const answers = to.edits.begin_snapshot(from.edits);
  answers->unresolved_bodies = unresolved_bodies();
  if (!from.edits.any()) {
    answers->islands = from.islands;
    to.loaded_memory = memories_of(from);
    return;
  }
  answers->islands.clear();
  to.loaded_memory.clear();
  for (const NextIsland& next : next_islands(from)) {
    answers->islands.push_back(next.island);
    if (!next.memory.is_none()) to.loaded_memory.emplace_back(next.island.first_body, next.memory);
  }
}

// ---- options and time

void World::set_options(const WorldOptions& options) {
  validate(options);
  check_next_tick("time_step", time(), options.time_step);
  if (options.time_step != impl_->options.time_step) set_time(time(), step_count());
  impl_->options = options;
  impl_->sleep.wake_all(impl_.get());
  impl_->edits.note_all();
}

void World::set_clock(Clock clock) { impl_->clock = clock; }
void World::set_stop_flag(StopFlag stop) { impl_->stop = stop; }

void World::set_time(double time, std::uint64_t step_count) {
  check_finite("time", time);
  check_next_tick("time", time, impl_->options.time_step);
  const double now = this->time();
  for (const Wrench& wrench : impl_->wrenches)
    for (const double moment : {wrench.start + (time - now), wrench.end + (time - now)})
      if (std::isfinite(moment) && std::abs(moment) > kMostMagnitude)
        refuse("time", "moves a wrench on " + in_quotes(this->body(wrench.body).name) +
                           " beyond 1e20 s, got " + shortest(time));
  for (std::size_t j = 0; j < impl_->joints.size(); ++j) {
    JointData& state = impl_->joint_states[j];
    // A motor that was set just now keeps its timeout to the bit.
    visit_motors(impl_->joints[j], state, [&](const Motor& motor, double& end) {
      end = time + (end == now + motor.timeout ? motor.timeout : end - now);
    });
    visit_starts(state.to_close, [&](double& since) { since = time + (since - now); });
  }
  for (Wrench& wrench : impl_->wrenches) {
    wrench.start += time - now;
    wrench.end += time - now;
  }
  for (IslandParts& parts : impl_->island_parts) parts.move(impl_->step_count, step_count);
  for (auto& [first_body, memory] : impl_->loaded_memory)
    memory.move(impl_->step_count, step_count);
  impl_->base_time = time;
  impl_->base_step = step_count;
  impl_->step_count = step_count;
  impl_->drop_spent_wrenches(time);  // far from 0 a short span rounds to nothing
}

void World::reserve_ids(const World& other) {
  impl_->next_body_id = std::max(impl_->next_body_id, other.impl_->next_body_id);
  impl_->next_joint_id = std::max(impl_->next_joint_id, other.impl_->next_joint_id);
  impl_->edits.forget_model_mark();
}

void World::continue_from(const World& other) {
  const double elapsed = other.time() - time();
  const std::uint32_t new_bodies = other.impl_->next_body_id.value - 1;
  const std::uint32_t new_joints = other.impl_->next_joint_id.value;
  if (impl_->next_body_id.value > kLastId - new_bodies ||
      impl_->next_joint_id.value > kLastId - new_joints)
    refuse("world", "gets no ids: all of them are used");
  set_time(other.time(), other.step_count());
  const auto renumber = [&](BodyId& id) {
    if (id != kWorldBody) id.value += new_bodies;
  };
  for (BodyId& id : impl_->body_ids) renumber(id);
  for (auto& [name, id] : impl_->body_by_name) renumber(id);
  for (Joint& joint : impl_->joints) {
    renumber(joint.body_a);
    renumber(joint.body_b);
    if (info(joint.kind).couples_joints)
      for (JointId* id : {&joint.coupling.first, &joint.coupling.second}) id->value += new_joints;
    // Shifts the phase, so that a sinusoid continues although time jumps.
    const auto shift = [&](Motor* motor) {
      if (motor->frequency > 0.0 && elapsed != 0.0)
        motor->phase =
            std::remainder(motor->phase - 2.0 * kPi * motor->frequency * elapsed, 2.0 * kPi);
    };
    shift(&joint.motor);
    for (CoordinateLaw& law : joint.coordinates)
      if (law.motor) shift(&*law.motor);
  }
  for (Wrench& wrench : impl_->wrenches) renumber(wrench.body);
  for (JointId& id : impl_->joint_ids) id.value += new_joints;
  for (auto& [name, id] : impl_->joint_by_name) id.value += new_joints;
  impl_->next_body_id.value += new_bodies;
  impl_->next_joint_id.value += new_joints;
  for (List<TouchingPair>* pairs : {&impl_->touching, &impl_->resting}) {
    for (TouchingPair& pair : *pairs) {
      renumber(pair.id_a);
      renumber(pair.id_b);
    }
  }
  for (auto& [first_body, memory] : impl_->loaded_memory) renumber(first_body);
  impl_->report = {};  // names bodies and joints by their old ids
  impl_->failed_joint.reset();
  impl_->monitors.set_unclosed({});
  impl_->contacts.clear();
  impl_->resting_contact_count = 0;
  impl_->events.clear();
  impl_->edits.note_topology();
  impl_->edits.note_all();
}

void World::Impl::forget_contacts() {
  sleep.wake_all(this);
  touching.clear();
  resting.clear();
  contacts.clear();
  resting_contact_count = 0;
  events.clear();
}

void World::Impl::forget_unknown_ids() {
  const auto is_gone = [&](auto id) { return find(id) < 0; };
  for (std::optional<BodyId>* body :
       {&report.energy.rise_body, &report.contacts.hits_left_body, &report.contacts.overlap_body,
        &report.contacts.creep_body, &report.contacts.unsolved_body, &report.outcome.failed_body,
        &report.contacts.handed_over_body})
    if (*body && is_gone(**body)) body->reset();
  for (std::optional<JointId>* joint : {&report.joints.worst, &report.joints.worst_closing,
                                        &report.joints.worst_unclosed, &failed_joint})
    if (*joint && is_gone(**joint)) joint->reset();
  std::vector<JointId> unclosed = monitors.unclosed();
  unclosed.erase(std::remove_if(unclosed.begin(), unclosed.end(), is_gone), unclosed.end());
  monitors.set_unclosed(unclosed);
}

// Whether both bodies are still there and still collide.
bool World::Impl::is_known(const TouchingPair& pair) const {
  return Model::is_known(pair.id_a) && Model::is_known(pair.id_b) &&
         may_collide(bodies[index(pair.id_a)], bodies[index(pair.id_b)]);
}

void World::reset() {
  for (std::size_t i = 0; i < impl_->bodies.size(); ++i) {
    impl_->states[i] = impl_->bodies[i].state;
    impl_->corrections[i].setZero();
  }
  impl_->any_corrections = false;
  for (std::size_t j = 0; j < impl_->joints.size(); ++j) {
    impl_->joints[j].motor = impl_->joint_starts[j].motor;
    impl_->joints[j].coordinates = impl_->joint_starts[j].coordinates;
    impl_->joints[j].enabled = impl_->joint_starts[j].enabled;
    JointEdits(impl_.get(), j).start();
  }
  impl_->wrenches.clear();
  impl_->monitors = Monitors{};
  impl_->loaded_memory.clear();
  impl_->forget_contacts();
  impl_->edits.note_topology();
  impl_->edits.note_all();
}

}  // namespace constraint_sim::engine
