#include "engine/islands/island_integration.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "engine/constraints/closing_errors.h"
#include "engine/constraints/coupling.h"
#include "engine/constraints/joint.h"
#include "engine/constraints/joint_kinds.h"
#include "engine/constraints/prescribed_motion.h"
#include "engine/islands/compile.h"
#include "engine/islands/coordinate_motions.h"
#include "engine/islands/method_choice.h"
#include "engine/islands/unresolved_bodies.h"
#include "engine/math/larger.h"
#include "engine/math/numbers.h"
#include "engine/model/impulse_method.h"

namespace constraint_sim::engine {
namespace {

using Eigen::Vector3d;

/// Whether a joint belongs to an island that is integrated.
bool is_integrated(const Model& model, const Topology& topology, const IslandLists& lists,
                   std::size_t j) {
  return !uses_impulses(lists.islands[topology.island_of_joint(model, j)].method);
}

void report_switch(const IntegrationStep& in, EventKind kind, std::size_t i) {
  const List<int>& members = in.lists->island_parts[i].members.bodies;
  const int second = members.size() > 1 ? members[1] : members[0];
  const double found = in.lists->island_parts[i].found.time;
  in.output->events.push_back({kind, in.state->time(in.model.options.time_step) + found,
                               in.model.body_ids[members[0]], in.model.body_ids[second]});
}

/// Switches the contacts of an island from events to impulses.
void switch_to_impulses(const IntegrationStep& in, std::size_t i, MethodReason why) {
  StepReport& report = in.output->report;
  learn_from_handover(why, in.state->step_count, in.model.options, &in.lists->island_parts[i]);
  ++report.contacts.handed_over;
  if (!report.contacts.handed_over_body)
    report.contacts.handed_over_body = in.lists->islands[i].first_body;
  report_switch(in, EventKind::kHandedOver, i);
}

/// Switches the contacts of an island back to events.
void switch_to_events(const IntegrationStep& in, std::size_t i) {
  if (in.lists->island_parts[i].left_for == MethodReason::kSmooth) return;
  in.lists->island_parts[i].left_for = MethodReason::kSmooth;
  report_switch(in, EventKind::kTakenBack, i);
}

/// Chooses the method of an island, and reports where its contacts change between methods.
MethodChoice choose_method(const IntegrationStep& in, std::size_t i, bool in_contact,
                           const ContactReach& reach, const ContactGroups& groups) {
  IslandParts& parts = in.lists->island_parts[i];
  const WorldOptions& options = in.model.options;
  MethodChoice choice = choose(parts.nature, in_contact, parts, in.state->step_count, options);
  if (groups.contains(i)) choice = {Method::kEventDriven, MethodReason::kFewContacts};
  if (groups.contains(i)) switch_to_events(in, i);
  if (choice.why == MethodReason::kContact) choice.why = groups.why_left(reach, i);
  if (parts.is_in_group && groups.is_left_in_contact(in.step, *in.state, reach, i)) {
    choice = {impulses_of(options), groups.why_left(reach, i)};
    switch_to_impulses(in, i, choice.why);
  }
  remember_choice(choice, in_contact, in.state->step_count, &parts);
  return choice;
}

/// Clears the results of the step before.
void begin_islands(const List<int>& integrated, const List<JointData>& joint_states,
                   IslandLists* lists) {
  for (const int i : integrated) {
    Island& island = lists->islands[i];
    island.local_error = 0.0;
    island.substeps = island.rejected = island.evaluations = island.iterations =
        island.unresolved_bodies = 0;
    IslandParts& parts = lists->island_parts[i];
    parts.projected_energy = parts.correction_work = 0.0;
    parts.changes = 0;
    parts.found = {};
    parts.needs_method_choice = parts.has_failed = false;
    if (parts.motion >= 0) lists->motions[parts.motion].begin_step(joint_states);
  }
}

// Lets a joint that does not fit begin to close its error at time t [s]. Coordinates that move
// to a position of their motor keep their rates.
void begin_misfit(const Model& model, std::size_t j, double t, State* state) {
  const CoordinateMotions motions(model, *state, j);
  const bool was_closing = state->joint_states[j].closing;
  begin_closing(model, j, t, state);
  if (was_closing) motions.send(model, motions.are_prescribed(), state);
}

}  // namespace

void begin_closing(const Model& model, std::size_t j, double t, State* state) {
  const Joint& joint = model.joints[j];
  if (info(joint.kind).couples_joints)
    read_coupling(model.terms_of(j), state->joint_states, &state->joint_states[j].coupling);
  const std::size_t a = model.index(joint.body_a), b = model.index(joint.body_b);
  begin_joint(joint, state->states[a], state->states[b], t, state->joint_states[j],
              model.masses[b].can_turn());
}

void IslandIntegration::begin() {
  is_partition_new_ = true;
  time_varying_joints_.clear();
  interval_ends_.clear();
}

// Islands have no prescribed motions where impulses have always advanced them.
void IslandIntegration::continue_from(const Model& model, const Topology& topology,
                                      const AwakeSets& awake, const State& state,
                                      IslandLists* lists) {
  in_contact_.assign(lists->islands.size(), false);
  list_by_method(model, topology, awake, state, *lists);
  for (std::size_t i = 0; i < lists->islands.size(); ++i) {
    const IslandParts& parts = lists->island_parts[i];
    if (parts.is_fresh || parts.motion < 0 || uses_impulses(lists->islands[i].method)) continue;
    lists->motions[parts.motion].continue_from(state.time(model.options.time_step), state.states,
                                               model.options.gravity, loads_, prescribed_);
  }
}

void IslandIntegration::choose_methods(const IntegrationStep& in, bool may_change,
                                       const ContactReach& reach, Sleep* sleep,
                                       ContactGroups* groups) {
  entering_.clear();
  if (may_change || !in.lists->fresh_islands.empty() || any_rejected_ || any_needs_choice_ ||
      groups->had_groups() || !groups->is_empty())
    sort_islands(in, reach, sleep, groups);
  groups->end_choice();
  in.output->report.costs.islands = partition_.islands;
}

void IslandIntegration::sort_islands(const IntegrationStep& in, const ContactReach& reach,
                                     Sleep* sleep, ContactGroups* groups) {
  StepReport& report = in.output->report;
  in_contact_.resize(in.lists->islands.size());
  for (const int i : in.awake.islands) in_contact_[i] = false;
  for (const TouchingPair& pair : in.state->touching)
    for (const int body : {pair.a, pair.b})
      if (in.topology.island_of(body) >= 0) in_contact_[in.topology.island_of(body)] = true;

  bool changed =
      !in.lists->fresh_islands.empty() || sleep->awake_sets_changed() || !partition_.ended.empty();
  sleep->forget_change();
  any_rejected_ = any_needs_choice_ = false;
  for (const int index : in.awake.islands) {
    const std::size_t i = to_index(index);
    Island& island = in.lists->islands[i];
    IslandParts& parts = in.lists->island_parts[i];
    parts.found = {};
    const bool has_woken = island.why == MethodReason::kAtRest;
    const bool was_in_group = island.why == MethodReason::kFewContacts;
    const MethodChoice choice = choose_method(in, i, in_contact_[i], reach, *groups);
    any_rejected_ = any_rejected_ || choice.why == MethodReason::kRefused ||
                    in.state->step_count < parts.contacts_refused_until;
    any_needs_choice_ =
        any_needs_choice_ || choice.why == MethodReason::kInconsistent ||
        (choice.why == MethodReason::kStiff && parts.nature != MethodReason::kStiff);
    island.local_error = 0.0;
    island.substeps = island.rejected = island.evaluations = island.iterations =
        island.dependent_rows = 0;
    island.events = 0;
    island.unresolved_bodies = 0;
    const Method before = island.method;
    island.method = choice.method;
    island.why = choice.why;
    const bool changes_method = island.method != before || was_in_group != groups->contains(i);
    if (!changes_method && !parts.is_fresh && !has_woken) continue;
    changed = true;
    if (!parts.is_fresh && island.method != before) ++report.costs.method_changes;
    parts.energy.has_changed |=
        !parts.is_fresh && (uses_impulses(island.method) || uses_impulses(before));
    parts.energy.has_changed |= groups->contains(i);  // bodies that touch exchange energy
    const bool restarts = parts.is_fresh || has_woken;
    if (restarts) {
      restart(parts, &in.lists->motions);
    } else if (parts.motion >= 0) {
      IslandMotion& motion = in.lists->motions[parts.motion];
      if (uses_impulses(before) || uses_impulses(island.method))
        motion.forget();
      else
        motion.change_method();
    }
    if ((restarts || uses_impulses(before)) && !uses_impulses(island.method))
      entering_.push_back(static_cast<int>(i));
  }
  if (groups->had_groups() || !groups->is_empty())
    groups->list_bodies(in.model, *in.lists, in.awake);
  if (changed) list_by_method(in.model, in.topology, in.awake, *in.state, *in.lists);
}

// Clears the memory of an island's method, so that a loaded scene continues with the same bits.
void IslandIntegration::restart(const IslandParts& parts, List<IslandMotion>* motions) {
  for (const int body : parts.turning_freely)
    if (to_index(body) < rotations_.size()) rotations_[body] = FreeRotation{};
  if (parts.motion >= 0) (*motions)[parts.motion].restart();
}

// Islands are integrated in parallel, and must find their places.
void IslandIntegration::make_room_for_rotations(const IslandParts& parts) {
  for (const int body : parts.turning_freely)
    rotations_.resize(std::max(rotations_.size(), to_index(body) + 1));
}

void IslandIntegration::list_by_method(const Model& model, const Topology& topology,
                                       const AwakeSets& awake, const State& state,
                                       const IslandLists& lists) {
  is_partition_new_ = true;
  partition_.integrated.clear();
  partition_.islands = {};
  for (const int i : awake.islands) {
    ++partition_.islands[static_cast<std::size_t>(lists.islands[i].method)];
    if (uses_impulses(lists.islands[i].method)) continue;
    partition_.integrated.push_back(i);
    make_room_for_rotations(lists.island_parts[i]);
  }
  partition_.impulse_bodies.clear();
  partition_.impulse_joints.clear();
  partition_.ended.clear();
  for (const int i : awake.islands)
    if (lists.island_parts[i].found.time > 0.0) partition_.ended.push_back(i);
  for (const int body : awake.bodies) {
    const int island = topology.island_of(body);
    if (island >= 0 && uses_impulses(lists.islands[island].method))
      partition_.impulse_bodies.push_back(body);
  }
  for (const int j : awake.joints)
    if (acts(model.joints[j], state.joint_states[j]) &&
        !is_integrated(model, topology, lists, to_index(j)))
      partition_.impulse_joints.push_back(j);
}

void IslandIntegration::integrate(const IntegrationStep& in, const ContinuousCollision& continuous,
                                  ContactGroups* groups) {
  IslandLists* const lists = in.lists;
  StepReport& report = in.output->report;
  const List<int>& integrated = partition_.integrated;
  const StageTimer timer(in.step.clock, Stage::kIntegration, &report.costs.stage_times);
  if (!entering_.empty()) begin_entering(in);
  if (is_partition_new_) list_time_varying_joints(in.model, *in.state, *lists);
  begin_islands(integrated, in.state->joint_states, lists);
  // a thread takes tens of microseconds to wake up, which some hundreds of bodies are worth
  constexpr std::size_t kBodiesWorthIt = 500;
  const int threads = integrated.size() > 1 && in.awake.bodies.size() >= kBodiesWorthIt
                          ? in.model.options.threads
                          : 1;
  split_step(in);
  for (std::size_t k = 0; k + 1 < interval_ends_.size(); ++k) {
    const double t = interval_ends_[k];
    const JointStep interval = joint_step(in.model.options, t, interval_ends_[k + 1] - t);
    const bool had_loads = !loads_.empty();
    if (!in.state->wrenches.empty() || had_loads)
      find_loads(in.model, *in.state, t, interval_ends_[k + 1]);
    const bool is_disturbed = had_loads || !loads_.empty() || k > 0;
    for (const int j : time_varying_joints_)
      if (is_integrated(in.model, in.topology, *lists, to_index(j)))
        prescribed_[j].begin(in.model.joints[j], interval, in.state->joint_states[j]);
    const double since = t - in.step.tick.start;
    const Interval continued{t,      interval.h,   in.model.options.gravity,
                             loads_, prescribed_,  is_disturbed,
                             k > 0,  in.step.stop, since};
    // Fast pairs with joints that impulses advance are followed from the start of the step.
    const bool keeps_found = continuous.jointed_pairs().empty();
    workers_.run(threads, integrated.size(), [&](std::size_t s) {
      const std::size_t i = to_index(integrated[s]);
      IslandParts& parts = lists->island_parts[i];
      if (parts.has_failed || groups->contains(i)) return;
      if (parts.is_fresh)
        parts.has_failed = !integrate_island(in, i, continued.after_edit());
      else
        parts.has_failed = !integrate_island(in, i, continued);
    });
    for (const int i : integrated)
      if (lists->island_parts[i].has_failed && !uses_impulses(lists->islands[i].method))
        give_up(in, to_index(i), MethodReason::kRefused, continued, keeps_found);
    if (!groups->is_empty()) advance_groups(in, continued, keeps_found, groups);
    for (const int j : time_varying_joints_)
      if (is_integrated(in.model, in.topology, *lists, to_index(j)))
        finish_interval(in.model.joints[j], interval, in.state->joint_states[j]);
  }
  if (!continuous.jointed_pairs().empty()) {
    for (const int i : continuous.find_passing(in.step, *in.state, in.rollback, *lists)) {
      begin_anew(in, to_index(i), MethodReason::kContact);
      remember_choice({impulses_of(in.model.options), MethodReason::kContact}, true,
                      in.state->step_count, &lists->island_parts[i]);
    }
  }
  if (!groups->is_empty()) groups->take_out_contacts(in.topology, &in.state->touching);
  if (report_islands(in, *groups)) {
    list_by_method(in.model, in.topology, in.awake, *in.state, *lists);
    report.costs.islands = partition_.islands;
  }
}

// Begins islands that were not integrated in the step before, or were edited. Joints that do not
// fit close their errors from here on.
void IslandIntegration::begin_entering(const IntegrationStep& in) {
  const JointStep interval =
      joint_step(in.model.options, in.step.tick.start, in.model.options.time_step);
  for (const int i : entering_) {
    IslandParts& parts = in.lists->island_parts[i];
    // a saved scene knows which joints cannot all be met
    const bool is_known_off = in.lists->islands[i].why == MethodReason::kInconsistent;
    for (const int index : parts.members.joints) {
      const std::size_t j = to_index(index);
      if (!is_known_off && is_rigid(in.model.joints[j]) &&
          !fits(in.model.joints[j], in.topology.state_a(*in.state, j),
                in.topology.state_b(*in.state, j), interval, in.state->joint_states[j]))
        begin_misfit(in.model, j, interval.t, in.state);
    }
    compile_if_opened(in.model, in.topology, in.state->joint_states, &parts, &in.lists->motions);
  }
  prescribed_.resize(in.model.joints.size());
  for (const int i : entering_)
    for (const int index : in.lists->island_parts[i].members.joints)
      prescribed_[index].begin(in.model.joints[index], interval, in.state->joint_states[index]);
}

void IslandIntegration::compile_where_closed(const Model& model, const Topology& topology,
                                             const JointStep& interval, State* state,
                                             IslandLists* lists) {
  for (const int index : time_varying_joints_) {
    const std::size_t j = to_index(index);
    if (state->joint_states[j].closing || forms(model.joints[j].kind).form != RowsForm::kPoint)
      continue;
    prescribed_[j].begin(model.joints[j], interval, state->joint_states[j]);
    compile_if_opened(model, topology, state->joint_states,
                      &lists->island_parts[topology.island_of_joint(model, j)], &lists->motions);
  }
}

void IslandIntegration::compile_if_opened(const Model& model, const Topology& topology,
                                          const List<JointData>& joint_states, IslandParts* parts,
                                          List<IslandMotion>* motions) {
  if (parts->motion < 0) return;
  const List<int> open_points = open_points_of(model, joint_states, parts->members);
  if (open_points == parts->open_points) return;
  compile_island(model, topology, open_points, parts, motions);
  make_room_for_rotations(*parts);
  restart(*parts, motions);
}

// Also joints whose motors stand still at the end of their travel.
void IslandIntegration::list_time_varying_joints(const Model& model, const State& state,
                                                 const IslandLists& lists) {
  is_partition_new_ = false;
  time_varying_joints_.clear();
  for (const int i : partition_.integrated) {
    for (const int index : lists.island_parts[i].members.joints) {
      if (state.joint_states[index].closing || has_moving_motor(model.joints[index]))
        time_varying_joints_.push_back(index);
    }
  }
}

// Splits the step where forces or prescribed velocities jump.
void IslandIntegration::split_step(const IntegrationStep& in) {
  const Tick& tick = in.step.tick;
  interval_ends_.resize(2);
  interval_ends_[0] = tick.start;
  interval_ends_[1] = tick.end;
  if (in.state->wrenches.empty() && time_varying_joints_.empty()) return;
  // Share of the time step within which times are moved to its ends: rounding of times after some
  // million steps, as in are_equal_steps().
  constexpr double kEndShare = 1e-9;
  const double margin = kEndShare * in.model.options.time_step;
  const auto split_at = [&](double time) {
    if (time > tick.start + margin && time < tick.end - margin) interval_ends_.push_back(time);
  };
  for (const Wrench& wrench : in.state->wrenches) {
    split_at(wrench.start);
    split_at(wrench.end);
  }
  for (const int j : time_varying_joints_) {
    visit_motors(in.model.joints[j], in.state->joint_states[j],
                 [&](const Motor&, double end) { split_at(end); });
    if (in.state->joint_states[j].closing)
      visit_ends(in.state->joint_states[j].to_close, in.model.options.closing_time, split_at);
  }
  if (interval_ends_.size() == 2) return;
  std::sort(interval_ends_.begin(), interval_ends_.end());
  interval_ends_.erase(std::unique(interval_ends_.begin(), interval_ends_.end()),
                       interval_ends_.end());
}

void IslandIntegration::find_loads(const Model& model, const State& state, double from, double to) {
  loads_.clear();
  const double middle = 0.5 * (from + to);
  for (const Wrench& wrench : state.wrenches)
    if (wrench.start <= middle && middle < wrench.end)
      loads_.push_back({static_cast<int>(model.index(wrench.body)), wrench.force, wrench.torque});
}

bool IslandIntegration::integrate_island(const IntegrationStep& in, std::size_t i,
                                         const Interval& interval) {
  State* const state = in.state;
  IslandLists* const lists = in.lists;
  IslandParts& parts = lists->island_parts[i];
  const bool is_done = parts.motion < 0 || integrate_joints(in, i, interval);
  const double h = is_done ? interval.h : parts.found.time;
  for (const int body : parts.turning_freely) {
    if (h == 0.0) return false;
    Vector3d torque = Vector3d::Zero();
    for (const AppliedWrench& load : loads_)
      if (load.body == body) torque += load.torque;
    if (!FreeRotation::turns(torque, state->states[body])) continue;
    if (!add_result(lists, i,
                    rotations_[body].advance(h, torque, in.model.masses[body],
                                             integrator_options(in, kInfinity), interval.stop,
                                             &state->states[body])))
      return false;
    if (!is_done) parts.found.time = h;
  }
  if (parts.motion >= 0) return is_done;

  const int body = parts.members.bodies.front();
  Vector3d acceleration = in.model.gravity_on(to_index(body));
  for (const AppliedWrench& load : loads_)
    if (load.body == body) acceleration += in.model.masses[body].inverse_mass * load.force;
  integrate_ballistic(interval.h, acceleration, &state->states[body]);
  return true;
}

void IslandIntegration::advance_groups(const IntegrationStep& in, const Interval& part,
                                       bool keeps_found, ContactGroups* groups) {
  Interval interval = part;
  if (interval_ends_.size() == 2)
    interval.h = in.model.options.time_step;  // the whole step, however late it is
  for (std::size_t g = 0; g < groups->groups().size(); ++g) {
    const ContactGroup& group = groups->groups()[g];
    if (group.has_failed) continue;
    const IntegrationResult progress =
        groups->advance(g, interval, integrator_options(in, kInfinity), in.model.options, in.state);
    const bool is_done = add_result(in.lists, to_index(group.islands.front()), progress);
    for (const int i : group.islands) {
      if (i != group.islands.front()) in.lists->islands[i].local_error += progress.local_error;
      if (group.islands.size() > 1)
        in.lists->island_parts[i].energy.has_changed = true;  // exchanged
    }
    if (is_done) continue;
    groups->mark_failed(g, keeps_found && progress.found > 0.0);
    for (const int i : group.islands) {
      in.lists->island_parts[i].found.time = progress.found;
      give_up(in, to_index(i), MethodReason::kContactsGivenUp, part, keeps_found);
    }
  }
}

// Adds up the results of islands in their order, which does not depend on the number of threads.
// True where the method of an island changed.
bool IslandIntegration::report_islands(const IntegrationStep& in, const ContactGroups& groups) {
  IslandLists* const lists = in.lists;
  StepReport& report = in.output->report;
  bool any_changed = false;
  report.costs.rows = 0;
  for (const int index : partition_.integrated) {
    Island& island = lists->islands[index];
    IslandParts& parts = lists->island_parts[index];
    report.energy.projected += parts.projected_energy;
    report.costs.method_changes += parts.changes;
    any_needs_choice_ = any_needs_choice_ || parts.needs_method_choice;
    any_changed = any_changed || parts.changes > 0;
    if (uses_impulses(island.method)) continue;  // rejected within the step
    if (parts.motion >= 0) {
      const IslandMotion& motion = lists->motions[parts.motion];
      const EquationsOfMotion& equations = motion.equations();
      report.costs.rows += static_cast<std::uint32_t>(equations.rows());
      island.dependent_rows = static_cast<std::uint32_t>(equations.delassus().dependent());
      island.events = motion.events();
    }
    if (groups.contains(to_index(index))) island.events = groups.events_of(to_index(index));
    report.costs.events += island.events;
    if (island.method == Method::kEnergyMomentum && island.why != MethodReason::kInconsistent)
      island.unresolved_bodies = find_unresolved(in.model, *in.state, in.rollback, parts.members,
                                                 lists->motions[parts.motion], nullptr);
    report.unresolved_bodies += island.unresolved_bodies;
    report.local_error = larger(report.local_error, island.local_error);
    report.joints.dependent_rows = std::max(report.joints.dependent_rows, island.dependent_rows);
    report.costs.substeps += island.substeps;
    report.costs.rejected += island.rejected;
    report.costs.evaluations += island.evaluations;
    report.costs.iterations += island.iterations;
  }
  return any_changed;
}

// Leaves this step of an island that could not be advanced in a part of it, and some more steps,
// to impulses. A motion that events found is kept; else the step begins anew.
void IslandIntegration::give_up(const IntegrationStep& in, std::size_t i, MethodReason why,
                                const Interval& part, bool keeps_found) {
  IslandParts& parts = in.lists->island_parts[i];
  if (!keeps_found || parts.found.time == 0.0) return begin_anew(in, i, why);
  const JointStep found = joint_step(in.model.options, part.t, parts.found.time);
  for (const int j : time_varying_joints_) {
    if (in.topology.island_of_joint(in.model, to_index(j)) != i) continue;
    prescribed_[j].begin(in.model.joints[j], found, in.state->joint_states[j]);
    finish_interval(in.model.joints[j], found, in.state->joint_states[j]);
  }
  parts.found = {part.since_tick + parts.found.time, in.lists->islands[i].local_error};
  in.output->report.energy.correction_work += parts.correction_work;
  reject(in, i, why);
}

// Leaves this step of an island, from its start, and some more steps to impulses.
void IslandIntegration::begin_anew(const IntegrationStep& in, std::size_t i, MethodReason why) {
  IslandParts& parts = in.lists->island_parts[i];
  parts.found = {};
  in.rollback.restore(parts.members, in.state);
  parts.projected_energy = parts.correction_work = 0.0;
  reject(in, i, why);
}

// Leaves the rest of this step of an island, and some more steps, to impulses.
void IslandIntegration::reject(const IntegrationStep& in, std::size_t i, MethodReason why) {
  StepReport& report = in.output->report;
  in.lists->islands[i].method = impulses_of(in.model.options);
  in.lists->islands[i].why = why;
  in.lists->island_parts[i].is_in_group = false;
  if (why == MethodReason::kContactsGivenUp)
    switch_to_impulses(in, i, why);
  else if (why != MethodReason::kContact)
    learn_from_refusal(in.state->step_count, &in.lists->island_parts[i]);
  any_rejected_ = true;
  ++in.lists->island_parts[i].changes;
  in.lists->island_parts[i].energy.has_changed = true;
  report.costs.rejected += in.lists->islands[i].rejected;
  report.costs.evaluations += in.lists->islands[i].evaluations;
}

}  // namespace constraint_sim::engine
