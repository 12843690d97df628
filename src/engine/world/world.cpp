#include "constraint_sim/engine/world.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "engine/collision/narrowphase.h"
#include "engine/constraints/contact.h"
#include "engine/constraints/custom_code.h"
#include "engine/constraints/joint.h"
#include "engine/constraints/joint_kinds.h"
#include "engine/constraints/joint_load.h"
#include "engine/impulses/free_turn.h"
#include "engine/islands/method_choice.h"
#include "engine/math/larger.h"
#include "engine/model/impulse_method.h"
#include "engine/model/validate.h"
#include "engine/world/bounds.h"
#include "engine/world/world_impl.h"

namespace constraint_sim::engine {

using Eigen::Vector3d;

namespace {

/// Returns everything that the integration of islands reads and writes beside its own fields.
IntegrationStep integration_step(const StepContext& step, WorldImpl* world) {
  State* const state = world;
  IslandLists* const lists = world;
  StepOutput* const output = world;
  return {step,  step.model, step.topology, world->sleep.awake(), world->rollback,
          state, lists,      output};
}

}  // namespace

// The numbers count the stages of the tutorial (docs/tutorial.md): broad phase, narrow phase, rows,
// velocities, sweeps, positions. Impl inherits Model, State, IslandLists and StepOutput, so one
// `world` is passed as each of them. A step in which a stage throws StepFailed or CustomFailure
// ends with the bodies where they began, and a report; other exceptions, as std::bad_alloc, leave
// step(). Where return_if_missed returns true, the stages from the broad phase on are repeated. In
// the table, `groups` are the event-driven groups. Each stage may also write the report.
//
// stage                        | reads                     | writes
// begin_step                   | edits, wakings            | topology, islands, touching, resting,
//                              |                           | awake sets, rollback; clears report
//                              |                           | and events
// run_broadphase               | poses, velocities, paths  | fast bodies, pairs of `pipeline` and
//                              |                           | `reach`
// run_narrowphase              | pairs, poses, touching    | touching, resting, fast pairs, groups,
//                              |                           | awake sets, rollback
// remove_correction_velocities | corrections               | velocities, corrections
// choose_methods               | islands, groups, touching | methods, partition, motions, events,
//                              |                           | `unseen`
// integrate                    | partition, groups,        | states, joint_states, motions, groups,
//                              | wrenches                  | touching, events; moves rejected
//                              |                           | islands to the impulse part of the
//                              |                           | partition
// advance_by_impulses          | partition, touching,      | states, joint_states, corrections,
//                              | wrenches                  | touching, missed hits
// return_if_missed             | states, rollback          | missed hits; or assumed paths, and the
//                              |                           | state before the step
// advance_kinematic_bodies     | velocities                | states
// finish_step                  | motions, groups, unseen   | joint_states, touching, contacts,
//                              |                           | events, report; then awake sets,
//                              |                           | wrenches and step_count
const StepReport& World::step() {
  Impl& world = *impl_;
  const std::uint64_t step_count = world.step_count;
  try {
    const StepContext step = world.begin_step();
    bool is_due = world.sleep.needs_stages();
    while (is_due) {
      // Only ContactReach::grow(), in run_broadphase(), replaces the pairs of an earlier attempt.
      world.reach.forget_pairs();
      if (!world.pipeline.moving_shapes().empty())
        world.run_broadphase(step);  // 1. broadphase: fast and approximate
      if (world.has_near_bodies())
        world.run_narrowphase(step);  // 2. narrowphase: accurate but slow
      if (world.any_corrections)
        world.remove_correction_velocities(
            world.sleep.awake().bodies);  // velocities that closed errors in the last step
      world.choose_methods(step);
      world.integrate(step);  // islands of runge_kutta, energy_momentum, event_driven
      if (!world.integration.partition().impulse_bodies.empty())
        world.advance_by_impulses(step);  // 3. to 6.: all other islands, by SequentialImpulses
      // Returns to the start of the step, with longer assumed paths, where a body may have met a
      // shape that no pair covers.
      is_due = world.assumed.may_outrun(world) && world.return_if_missed(step);
    }
    world.advance_kinematic_bodies();
    world.finish_step(step);
  } catch (const StepFailed& failed) {
    world.end_failed_step(failed.why);
  } catch (const CustomFailure& failed) {
    world.fail_by(failed);
  } catch (...) {
    world.step_count = step_count;  // finish_step() may have counted the step already
    world.abandon_step();
    throw;
  }
  // After a failure or a stop this reports the errors and the energy of the restored state, and
  // watches nothing.
  world.monitors.measure({world, world, world.topology, world.rollback, world.sleep.awake(),
                          world.groups, world.integration.partition()},
                         &world, &world.report);
  return world.report;
}

StepContext World::Impl::begin_step() {
  rollback.begin_step();
  assumed.begin_step();
  if (edits.any())
    rebuild_topology();
  else if (sleep.has_new_waking())
    spread_waking();
  save_state();
  const StepContext step{
      *this, topology, assumed, {time(), time_of(step_count + 1, options.time_step)}, stop, clock};
  report = StepReport{};
  events.clear();
  pipeline.begin_step();
  if (!has_next_tick(step.tick.start, options.time_step) || step.tick.end > kMostMagnitude)
    throw StepFailed{Failure::kNoNextTick};
  return step;
}

void World::Impl::save_state() {
  rollback.save(sleep.awake(), *this, island_parts);
  if (assumed.may_outrun(*this)) rollback.save_methods(sleep.awake(), *this);
}

void World::Impl::restore_state() {
  rollback.restore(sleep.awake(), this, &island_parts);
  pipeline.restore_contacts(&touching);
}

void World::Impl::choose_methods(const StepContext& step) {
  continuous.begin_step();
  control.begin_step();
  unseen.begin_step();
  const bool may_change =
      sleep.awake_sets_changed() || !touching.empty() || !pipeline.touching_before().empty();
  integration.choose_methods(integration_step(step, this), may_change, reach, &sleep, &groups);
  note_pairs(step);
}

// Takes over the pairs that may overlap without a contact. With contacts by events these are
// the pairs that may touch within the step, and all near pairs once impulses advance a body.
void World::Impl::note_pairs(const StepContext& step) {
  if (controls_contacts(options)) return;
  if (follows_contacts(options) && integration.partition().impulse_bodies.empty()) {
    for (const auto& [pair, apart] : reach.watched_pairs())
      unseen.note(step, *this, *this, groups, pair);
    return;
  }
  if (pipeline.moving_shapes().empty()) return;
  for (const Broadphase::Pair& pair : pipeline.pairs())
    unseen.note(step, *this, *this, groups, pair);
}

void World::Impl::integrate(const StepContext& step) {
  if (!integration.partition().integrated.empty())
    integration.integrate(integration_step(step, this), continuous, &groups);
}

// Lists the wrenches that act within the step on bodies that impulses advance, with the duration of
// each within the step. In a step that events began it is the duration in the rest of the step, as
// if the rest were as long as the step.
void World::Impl::find_acting_wrenches(const StepContext& step) {
  for (const Wrench& wrench : wrenches) {
    const std::size_t i = index(wrench.body), island = to_index(topology.island_of(i));
    if (!uses_impulses(islands[island].method)) continue;
    const double found = island_parts[island].found.time, start = step.tick.start + found;
    const bool acts_throughout = wrench.start <= start && wrench.end >= step.tick.end;
    double duration = acts_throughout
                          ? options.time_step
                          : std::min(wrench.end, step.tick.end) - std::max(wrench.start, start);
    if (duration <= 0.0) continue;  // the wrench begins after this step
    // parts of a step take their share of the duration
    if (found > 0.0 && !acts_throughout)
      duration *= options.time_step / (options.time_step - found);
    acting_wrenches.push_back({i, duration, wrench.force, wrench.torque});
  }
}

// Adds the forces of plugins on bodies that impulses advance, as wrenches that stay constant from
// the start of the step.
void World::Impl::find_custom_forces(const StepContext& step) {
  for (const int index : integration.partition().impulse_joints) {
    const auto j = static_cast<std::size_t>(index);
    if (!is_custom_force(joints[j].kind) || !acts(joints[j], joint_states[j])) continue;
    const Jacobian wrench = custom_wrench(joints[j], topology.state_a(*this, j),
                                          topology.state_b(*this, j), step.tick.start);
    const auto [a, b] = topology.ends(j);
    if (is_movable(a)) acting_wrenches.push_back({a, options.time_step, wrench.j1, wrench.j2});
    if (is_movable(b)) acting_wrenches.push_back({b, options.time_step, wrench.j3, wrench.j4});
  }
}

void World::Impl::advance_by_impulses(const StepContext& step) {
  const bool any_found = !integration.partition().ended.empty();
  if (any_found) read_found(step, this);
  sequential_impulses.begin_step(bodies.size());
  acting_wrenches.clear();
  if (!wrenches.empty()) find_acting_wrenches(step);
  if (topology.has_custom_forces()) find_custom_forces(step);
  if (!continuous.jointed_pairs().empty()) continuous.add_jointed_pairs(step, *this, this);
  if (controls_contacts(options)) {
    const ContactControl::Outcome controlled =
        control.advance(step, sleep.awake(), integration.partition().impulse_bodies,
                        integration.partition().impulse_joints, *this, acting_wrenches, &pipeline,
                        &sequential_impulses, this);
    add_impulses(controlled.impulses, &report);
    report.costs.substeps += controlled.substeps;
    report.costs.rejected += controlled.rejected;
    report.contacts.hits += controlled.hits;
    if (controlled.left_body) continuous.note_missed_hits(*controlled.left_body);
    return;
  }
  if ((any_found || !continuous.fast_bodies().empty()) &&
      continuous.divide(step, *this, integration.partition().impulse_bodies,
                        integration.partition().impulse_joints, this)) {
    const HitReport hits =
        continuous.advance(step, *this, sleep.awake(), pipeline.moving_shapes(), acting_wrenches,
                           pipeline.broadphase(), &sequential_impulses, this);
    add_impulses(hits.impulses, &report);
    report.contacts.hits += hits.hits;
    if (continuous.others().is_empty()) return;
    const auto is_spent = [&](const ActingWrench& wrench) {
      return continuous.divides(static_cast<int>(wrench.body));
    };
    acting_wrenches.erase(std::remove_if(acting_wrenches.begin(), acting_wrenches.end(), is_spent),
                          acting_wrenches.end());
  }
  add_impulses(sequential_impulses.advance(*this, impulse_step(step), this), &report);
}

void World::Impl::finish_impulses(const StepContext& step) {
  if (!control.is_used() && (!continuous.is_divided() || !continuous.others().is_empty()))
    report.energy.correction_work += sequential_impulses.finish(*this, impulse_step(step), this);
  if (continuous.is_divided()) report.contacts.points += continuous.return_contacts(this);
  for (const int j : integration.partition().impulse_joints)
    if (joint_states[j].broken) mark_broken(to_index(j));
}

// Sets the error estimates of islands that impulses advance, and adds them to the report. An
// overlap that no contact saw counts twice: a body may have bounced as far. Sets estimates to NaN
// where joints cannot all be met, and where hits were left out: these motions have no estimate.
void World::Impl::set_estimates(const StepContext& step) {
  constexpr double kUnknown = std::numeric_limits<double>::quiet_NaN();
  for (const int island : integration.partition().integrated)
    if (islands[island].why == MethodReason::kInconsistent)
      islands[island].local_error = report.local_error = kUnknown;
  if (integration.partition().impulse_bodies.empty() && unseen.is_empty()) return;
  const auto island_of = [&](int body) { return topology.island_of(to_index(body)); };
  const List<int>& bodies = integration.partition().impulse_bodies;
  for (const int body : bodies) islands[island_of(body)].local_error = 0.0;
  for (const int body : bodies) {
    double& error = islands[island_of(body)].local_error;
    const double of_impulses =
        control.is_used() ? control.error_of(body) : sequential_impulses.error_of(to_index(body));
    error = larger(error, island_parts[island_of(body)].found.error + of_impulses);
    if (continuous.first_body_with_missed_hits() && continuous.divides(body)) error = kUnknown;
  }
  for (const auto& [pair, depth] : unseen.find(step, rollback, *this))
    for (const int body : {pair.first, pair.second})
      if (is_movable(to_index(body)) && !asleep[body])
        islands[island_of(body)].local_error += 2.0 * depth;
  for (const int i : sleep.awake().islands)
    report.local_error = larger(report.local_error, islands[i].local_error);
}

ImpulseStep World::Impl::impulse_step(const StepContext& step) const {
  const bool is_divided = continuous.is_divided();
  return {joint_step(options, step.tick.start, options.time_step),
          contact_step(options, options.time_step),
          ImpulseStepKind::kWhole,
          is_divided ? continuous.others().bodies : integration.partition().impulse_bodies,
          is_divided ? continuous.others().joints : integration.partition().impulse_joints,
          topology.joint_ends(),
          topology.is_in_loop(),
          acting_wrenches,
          stop,
          clock};
}

void World::Impl::advance_kinematic_bodies() {
  if (sleep.awake().kinematic.empty()) return;
  const StageTimer timer(clock, Stage::kPositions, &report.costs.stage_times);
  advance_kinematic(sleep.awake().kinematic, options.time_step, states);
}

// Ends a step. A stop or an invalid motion ends the step before its results are read. The step may
// be rolled back until commit(), which also changes the awake sets that set_estimates() reads.
void World::Impl::finish_step(const StepContext& step) {
  if (is_set(stop)) {
    restore_start();
    report.outcome.stopped = true;
    return;
  }
  const AwakeSets& awake = sleep.awake();
  if (!awake.bodies.empty()) {
    const Failure failure =
        failure_of_motion(*this, *this, awake.bodies, &report.outcome.failed_body);
    if (failure != Failure::kNone) throw StepFailed{failure};
  }
  read_results(step);
  const bool is_anything_new = !awake.bodies.empty() || !awake.joints.empty();
  if (is_anything_new && !are_in_bounds(*this, *this, awake, *this))
    throw StepFailed{Failure::kNotFinite};
  set_estimates(step);
  commit(step);
}

// Reads forces, contacts and events out of the methods. Joints may break here. finish_impulses()
// comes before report_contact_groups(): rows of impulses refer to contacts by their place in
// `touching`, and event-driven groups insert contacts there. set_contacts() comes last, with the
// contacts of all methods.
void World::Impl::read_results(const StepContext& step) {
  if (!integration.partition().impulse_bodies.empty()) finish_impulses(step);
  if (!motions.empty() && !integration.partition().integrated.empty())
    read_integrated_joints(joint_step(options, step.tick.start, options.time_step));
  if (!groups.is_empty())
    report_contact_groups(joint_step(options, step.tick.start, options.time_step));
  if (!sleep.awake().joints.empty()) read_motors_of_parts(step, this);
  if (!touching.empty() || contacts.size() > resting_contact_count)
    set_contacts(touching, options.time_step);
  if (const std::optional<int> body = continuous.first_body_with_missed_hits())
    report.contacts.hits_left_body = body_ids[to_index(*body)];
}

// Counts a valid step, and prepares the next one. The order matters:
//  - The step is counted before fall_asleep(), which asks whether motors still drive at its end.
//  - Wrenches that ended are dropped before fall_asleep(), since wrenches keep islands awake.
//  - Islands that fall asleep move contacts from `touching` to `resting`, so list_resting() and
//    set_contacts() list both anew.
//  - compile_where_closed() replaces prescribed motions that read_results() has read.
//  - keep_self_stress() writes memory that no rollback restores.
void World::Impl::commit(const StepContext& step) {
  if (events.size() > 1) sort_events();
  ++step_count;
  drop_spent_wrenches(step.tick.end);
  if (const auto resting_sets =
          sleep.fall_asleep(*this, topology, reach.watched_pairs(), this, this)) {
    list_resting(*resting_sets);
    set_contacts(touching, options.time_step);
  }
  for (const int i : fresh_islands) island_parts[static_cast<std::size_t>(i)].is_fresh = false;
  fresh_islands.clear();
  if (!integration.time_varying_joints().empty())
    integration.compile_where_closed(
        *this, topology, joint_step(options, step.tick.start, options.time_step), this, this);
  if (!integration.partition().impulse_bodies.empty() && !continuous.is_divided() &&
      !control.is_used())
    sequential_impulses.keep_self_stress(&self_stress);
  report.step = step_count;
  report.time = step.tick.end;
}

// Marks a joint that broke in this step, and the couplings on it, as broken: impulses are cleared,
// errors are left open, and the islands are compiled anew. Couplings are read after their joints.
// The time is the end of the step, unless event_driven has reported an earlier one.
void World::Impl::mark_broken(std::size_t j) {
  const auto report_one = [&](std::size_t k) {
    const bool is_reported = std::any_of(events.begin(), events.end(), [&](const Event& event) {
      return event.kind == EventKind::kBroken && event.joint == joint_ids[k];
    });
    if (is_reported) return;
    events.push_back({EventKind::kBroken, time_of(step_count + 1, options.time_step),
                      joints[k].body_a, joints[k].body_b, joint_ids[k]});
  };
  forget_impulses(&joint_states[j]);
  joint_states[j].closing = false;
  report_one(j);
  for (const std::size_t coupling : couplings_of(j)) {
    joint_states[coupling].broken = true;
    joint_states[coupling].closing = false;
    report_one(coupling);
  }
  edits.note_topology();
  edits.note_islands_of(*this, joints[j]);
  ++report.joints.broken;
}

void World::Impl::drop_spent_wrenches(double now) {
  if (wrenches.empty()) return;
  const auto is_spent = [now](const Wrench& wrench) {
    return wrench.end <= std::max(now, wrench.start);
  };
  const auto spent = std::remove_if(wrenches.begin(), wrenches.end(), is_spent);
  if (spent == wrenches.end()) return;
  wrenches.erase(spent, wrenches.end());
  monitors.note_wrench_ended();
}

double World::Impl::time() const { return State::time(options.time_step); }

}  // namespace constraint_sim::engine
