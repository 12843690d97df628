#include "engine/world/world_impl.h"

#include <algorithm>
#include <array>
#include <limits>

#include "engine/constraints/custom_code.h"
#include "engine/islands/contact_group_reports.h"
#include "engine/islands/method_choice.h"
#include "engine/methods/event_driven/contacts/contact_events.h"

namespace constraint_sim::engine {
namespace {

/// Clears the forces of a joint that does not act.
void release(JointState* state) {
  state->force = state->bias = 0.0;
  state->saturated = false;
  for (CoordinateState& coordinate : state->coordinates) coordinate.effort = coordinate.bias = 0.0;
}

/// Adds the events of an island that joint events divided.
void add_joint_events(const Model& model, const EventDriven& from, std::vector<Event>* events) {
  for (const EventDriven::Reported& reported : from.reported()) {
    const std::size_t j = to_index(from.joints()[reported.joint]);
    events->push_back({reported.kind, reported.time, model.joints[j].body_a, model.joints[j].body_b,
                       model.joint_ids[j], reported.coordinate, reported.impulse});
  }
}

// Reads events and joints of an island that events advanced in a part of the step, or in all of it.
void read_events(const EventDriven& by_events, JointStep step, WorldImpl* world) {
  std::array<double, kMaxCoordinates> positions;
  add_joint_events(*world, by_events, &world->events);
  step.counted = positions.data();
  for (std::size_t l = 0; l < by_events.joints().size(); ++l) {
    by_events.write(l, &world->joint_states[by_events.joints()[l]], &positions);
    world->read_integrated_joint(to_index(by_events.joints()[l]), step, by_events.impulse(l),
                                 by_events.coupled_impulse(l));
  }
}

// Reads events, contacts and joints of a group that events advanced in a part of the step, or in
// all of it.
void read_group(const ContactGroup& group, JointStep step, WorldImpl* world) {
  List<JointData>& joint_states = world->joint_states;
  add_group_events(*world, group, world->integration.interval_ends().back(), &world->events);
  add_group_contacts(*world, world->states, group, &world->touching);
  if (group.spheres != nullptr) return;
  std::array<double, kMaxCoordinates> positions;
  step.counted = positions.data();
  const ContactEquations& equations = group.events->equations();
  const GroupJoints& joints = equations.joints();
  for (std::size_t c = 0; c < joints.coordinates().size(); ++c)
    group.events->reports().write(equations, c,
                                  &joint_states[joints[joints.coordinates()[c].joint].index]);
  for (std::size_t j = 0; j < joints.list().size(); ++j) {
    const GroupJoint& joint = joints[j];
    if (joint.is_broken) joint_states[joint.index].broken = true;
    positions.fill(std::numeric_limits<double>::quiet_NaN());
    joints.angles().read(j, &positions);
    world->read_integrated_joint(to_index(joint.index), step, joint.impulse.rows,
                                 joint.impulse.coupling);
  }
}

}  // namespace

// Rebuilds everything that follows from bodies, joints and options: once after an edit, before the
// first stage of a step.
void World::Impl::rebuild_topology() {
  edits.begin_compiling();

  topology.link_joints(*this, joint_states);
  for (std::size_t j = 0; j < joints.size(); ++j)
    if (!acts(joints[j], joint_states[j])) release(&joint_states[j]);

  const auto is_gone = [this](const TouchingPair& pair) { return !is_known(pair); };
  for (List<TouchingPair>* pairs : {&touching, &resting}) {
    pairs->erase(std::remove_if(pairs->begin(), pairs->end(), is_gone), pairs->end());
    for (TouchingPair& pair : *pairs) {
      pair.a = find(pair.id_a);
      pair.b = find(pair.id_b);
    }
  }

  integration.begin();

  if (edits.all())
    for (IslandParts& parts : island_parts) static_cast<IslandMemory&>(parts) = parts.after_edit();
  if (edits.any_topology()) {
    edits.end_topology();
    if (edits.all()) integration.forget_rotations();
    regroup(*this, group_bodies(*this, joint_states, topology.joint_ends()), [&](std::size_t body) {
      return !edits.all() && topology.knows(body) ? topology.island_of(body) : -1;
    });
    topology.set_islands(bodies.size(), island_parts);
    topology.find_loops(*this, joint_states, island_parts);
  }
  edits.mark_islands(*this, topology, this);
  compile_islands(*this, *this, topology, this);
  spread_waking();

  monitors.begin(*this, *this, topology, this);

  rollback.resize(*this, island_parts.size());
}

// Wakes everything that joints or contacts connect with awake bodies, and lists all sets anew.
void World::Impl::spread_waking() { list_resting(sleep.spread(*this, topology, this, this)); }

void World::Impl::list_resting(const RestingSets& resting_sets) {
  pipeline.set_shapes(*this, *this, sleep.awake().bodies, resting_sets.bodies);
  continuous.set_shapes(*this);
  assumed.set_shapes(*this, topology, *this, pipeline.moving_shapes());
  monitors.set_resting(*this, *this, resting_sets, *this);
  set_resting_contacts(resting, options.time_step);
}

// Stage 1: pairs of shapes that may touch within the step. With event-driven contacts, bounds are
// widened until no group grows any more (ContactReach).
void World::Impl::run_broadphase(const StepContext& step) {
  const List<int>& shapes = pipeline.moving_shapes();
  const StageTimer timer(step.clock, Stage::kBroadphase, &report.costs.stage_times);
  continuous.find_fast_bodies(step, *this, shapes);
  if (!follows_contacts(options))
    return pipeline.find_pairs(step, *this, continuous.fast_bodies(), nullptr, &report);
  reach.begin(step, *this, shapes);
  pipeline.find_pairs(step, *this, continuous.fast_bodies(), &reach, &report);
  // Each round but the last makes a group larger or faster. Groups still growing after kMostRounds
  // stay as they are.
  constexpr int kMostRounds = 40;
  for (int round = 0;
       reach.grow(step, *this, *this, sleep.awake(), pipeline.pairs()) && round < kMostRounds;
       ++round)
    pipeline.find_pairs(step, *this, continuous.fast_bodies(), &reach, &report);
}

// Stage 2: contacts where shapes touch now, hits of fast bodies, and event-driven groups. Repeats
// both stages while a touched body wakes up.
void World::Impl::run_narrowphase(const StepContext& step) {
  pipeline.collide(step, this, &report);
  find_hits(step);
  while (wake_touched()) {
    pipeline.restore_contacts(&touching);
    spread_waking();
    save_state();
    run_broadphase(step);
    pipeline.collide(step, this, &report);
    find_hits(step);
  }
  groups.find(step, *this, rollback, *this, sleep.awake(), reach, pipeline.touching_before());
}

void World::Impl::find_hits(const StepContext& step) {
  if (continuous.fast_bodies().empty()) return;
  continuous.find_hits(step, pipeline.pairs(), *this, this);
  for (const Broadphase::Pair& pair : continuous.jointed_pairs()) sleep.wake(pair.bodies(), this);
}

// Wakes bodies in contact, and sleeping bodies that may be touched within the step. Returns whether
// a body slept.
bool World::Impl::wake_touched() {
  for (const TouchingPair& pair : touching) sleep.wake(pair.ends(), this);
  if (!sleep.has_new_waking() && follows_contacts(options))
    for (const auto& [pair, apart] : reach.watched_pairs())
      if (asleep[pair.first] || asleep[pair.second]) sleep.wake(pair.bodies(), this);
  return sleep.has_new_waking();
}

// Returns to the start of the step, with longer assumed paths, where a body may have met a shape
// that no pair covers. Returns whether the step has to be repeated. Notes missed hits instead where
// paths have been made longer often enough.
bool World::Impl::return_if_missed(const StepContext& step) {
  if (is_set(stop)) return false;
  const MovedBodies moved{step,  *this,  rollback,  *this, pipeline.moving_shapes(),
                          reach, groups, continuous};
  const std::optional<int> body = assumed.find_missed(moved, pipeline.broadphase());
  if (!body) return false;
  if (!assumed.lengthen(bodies.size())) {
    continuous.note_missed_hits(*body);
    return false;
  }
  return_to_start();
  return true;
}

// Returns to the start of the step, with nothing left of the attempt but the paths that it found.
void World::Impl::return_to_start() {
  restore_state();
  rollback.restore_methods(sleep.awake(), this);
  sleep.choose_again();
  for (const int i : sleep.awake().islands)
    if (island_parts[i].motion >= 0) motions[island_parts[i].motion].forget();
  events.clear();
  const auto times = report.costs.stage_times;
  report = StepReport{};
  report.costs.stage_times = times;
}

// Ends a step that failed, with the bodies where they began.
void World::Impl::end_failed_step(Failure why) {
  restore_start();
  report.outcome.failed = true;
  report.outcome.failure = why;
}

// Restores the state before the step, and reports its time. Methods begin anew.
void World::Impl::restore_start() {
  restore_state();
  for (IslandMotion& motion : motions) motion.forget();
  restart_all();
  contacts.resize(resting_contact_count);
  events.clear();
  report.step = step_count;
  report.time = time();
}

// Ends a step in which the code of a plugin threw, on any thread. No plugin is called before the
// state is saved.
void World::Impl::fail_by(const CustomFailure& failed) {
  end_failed_step(Failure::kCustom);
  failed_why = failed.what();
  failed_joint.reset();
  const auto found = joint_by_name.find(failed.joint_name);
  if (found != joint_by_name.end()) failed_joint = found->second;
}

// Ends a step in which the system threw, as for lack of memory. Data of the step may be half
// written, so contacts are forgotten and all islands are compiled anew.
void World::Impl::abandon_step() {
  if (rollback.is_saved()) restore_state();
  forget_contacts();
  groups = ContactGroups{};
  edits.note_topology();
  edits.note_all();
  report = StepReport{};
  report.outcome.failed = true;
  report.step = step_count;
  report.time = time();
}

void World::Impl::read_integrated_joints(JointStep step) {
  std::array<double, kMaxCoordinates> positions;
  for (const int i : integration.partition().integrated) {
    if (island_parts[i].motion < 0 || groups.contains(to_index(i))) continue;
    IslandMotion& motion = motions[island_parts[i].motion];
    if (const EventDriven* by_events = motion.finish_events(states)) {
      read_events(*by_events, step, this);
      continue;
    }
    const EquationsOfMotion& equations = motion.equations();
    // With inconsistent joints, least_squares has already distributed the forces.
    const bool shares =
        equations.delassus().redundant() > 0 && islands[i].why != MethodReason::kInconsistent;
    const LeastNormForces* const shared = shares ? &motion.share_forces(states) : nullptr;
    const bool any_coupling = !equations.coupled_rows().empty();
    const bool any_counted = !equations.general_rows().empty();
    for (std::size_t l = 0; l < equations.joints().size(); ++l) {
      if (any_counted)
        step.counted =
            equations.coordinates().read(equations, l, &positions) ? positions.data() : nullptr;
      read_integrated_joint(
          to_index(equations.joints()[l]), step,
          shared ? shared->impulse(equations, l) : equations.forces().impulse(equations, l),
          !any_coupling ? 0.0
          : shared      ? shared->coupled_impulse(equations, l)
                        : equations.forces().coupled_impulse(equations, l));
    }
    step.counted = nullptr;
  }
}

void World::Impl::report_contact_groups(JointStep step) {
  const std::size_t first = touching.size();
  for (const ContactGroup& group : groups.groups())
    if (!group.has_failed) read_group(group, step, this);
  for (std::size_t i = first; i < touching.size(); ++i) {
    const Manifold& manifold = touching[i].manifold;
    report.contacts.points += static_cast<std::uint32_t>(manifold.count);
    for (std::size_t k = 0; k < to_index(manifold.count); ++k)
      report.contacts.max_penetration =
          std::max(report.contacts.max_penetration, manifold.points[k].depth);
  }
  std::sort(touching.begin(), touching.end(), TouchingPair::in_order);
}

// Reads the state and the force of a joint that was integrated.
void World::Impl::read_integrated_joint(std::size_t j, const JointStep& step,
                                        const RowVector& impulse, double coupled_impulse) {
  const PrescribedMotion& motion = integration.prescribed()[j];
  const double zeta = motion.is_driven() ? motion.zeta(step.t + step.h) : 0.0;
  const bool has_coupling = info(joints[j].kind).couples;
  JointData& state = joint_states[j];
  if (has_coupling) {
    if (info(joints[j].kind).couples_joints)
      read_coupling(terms_of(j), joint_states, &state.coupling);
    state.coupling_impulse = coupled_impulse;
    state.coupling.effort = coupled_impulse / step.h;
  }
  engine::read_integrated_joint(joints[j], topology.state_a(*this, j), topology.state_b(*this, j),
                                step, impulse, zeta, state);
  if (has_coupling && info(joints[j].kind).couples_joints)
    add_coupled_effort(terms_of(j), state.coupling.effort, &joint_states);
  if (state.broken) mark_broken(j);
}

void read_found(const StepContext& step, WorldImpl* world) {
  for (const int index : world->integration.partition().ended) {
    const std::size_t i = to_index(index);
    const JointStep found =
        joint_step(world->options, step.tick.start, world->island_parts[i].found.time);
    if (!world->groups.contains(i)) {
      IslandMotion& motion = world->motions[world->island_parts[i].motion];
      read_events(*motion.finish_events(world->states), found, world);
      world->report.costs.events += motion.events();
      continue;
    }
    const ContactGroup& group = world->groups.of(i);
    if (group.islands.front() != index) continue;
    read_group(group, found, world);
    world->report.costs.events += world->groups.events_of(i);
    world->report.energy.driven_work += world->groups.driven_work_of(i);
  }
  std::sort(world->touching.begin(), world->touching.end(), TouchingPair::in_order);
}

void read_motors_of_parts(const StepContext& step, WorldImpl* world) {
  const MethodPartition& partition = world->integration.partition();
  const bool is_split =
      !partition.integrated.empty() && world->integration.interval_ends().size() > 2;
  const bool is_divided = world->control.is_used() || world->continuous.is_divided();
  if (!is_split && !is_divided && partition.ended.empty()) return;
  const JointStep whole = joint_step(world->options, step.tick.start, world->options.time_step);
  for (const int j : world->sleep.awake().joints)
    if (has_moving_motor(world->joints[j]) && acts(world->joints[j], world->joint_states[j]))
      set_mean_rates(world->joints[j], whole, world->rollback.joint_states()[j],
                     world->joint_states[j]);
}

}  // namespace constraint_sim::engine
