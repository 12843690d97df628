// Which method carries which island, and the smooth ones carried: between stages 2 and 3 of a step.

#include <algorithm>
#include <cmath>

#include "engine/math/list.h"
#include "engine/math/numbers.h"
#include "engine/world/world_impl.h"

namespace constraint_sim::engine {
namespace {

using Eigen::Vector3d;

// What substeps may lose when they take over within a tick, as a share of the kinetic energy.
constexpr double kMostProjected = 1e-9;
// Substeps of an island in one span; of all bodies together; and what each has at least, so that a
// step of any number of bodies has an end.
constexpr int kMostAttempts = 50000, kLeastAttempts = 100;
constexpr std::size_t kMostAttemptsOfAll = 300000;

}  // namespace

// ---- methods chosen

MethodPartition& World::Impl::choose_methods() {
  entering.clear();
  if (!fresh_islands.empty() || sleep.has_changed() || !touching.empty() ||
      !pipeline.touching_before().empty() || any_refused || any_stiff || groups.had_groups() ||
      !groups.is_empty())
    sort_islands();
  groups.end_choice();
  report.islands = carried.islands;
  return carried;
}

void World::Impl::sort_islands() {
  in_contact.resize(islands.size());
  for (const int i : sleep.awake().islands) in_contact[i] = false;
  for (const TouchingPair& pair : touching)
    for (const int body : {pair.a, pair.b})
      if (topology.island_of(body) >= 0) in_contact[topology.island_of(body)] = true;

  bool changed = !fresh_islands.empty() || sleep.has_changed();
  sleep.forget_change();
  any_refused = any_stiff = false;
  for (const int index : sleep.awake().islands) {
    const std::size_t i = to_index(index);
    Island& island = islands[i];
    IslandParts& parts = island_parts[i];
    const bool has_woken = island.why == MethodReason::kAtRest;
    const bool was_in_group = island.why == MethodReason::kFewContacts;
    MethodChoice choice = choose(parts.nature, in_contact[i], parts, step_count, options);
    if (groups.contains(i)) choice = {Method::kEventDriven, MethodReason::kFewContacts};
    if (groups.contains(i)) take_back(i);
    if (choice.why == MethodReason::kContact) choice.why = groups.why_left(reach, i);
    if (was_in_group && !parts.is_fresh && groups.is_left_in_contact(topology, reach, i)) {
      choice = {Method::kSequentialImpulses, groups.why_left(reach, i)};
      hand_over(i, choice.why);
    }
    remember_choice(choice, in_contact[i], step_count, &parts);
    any_refused = any_refused || choice.why == MethodReason::kRefused ||
                  step_count < parts.contacts_refused_until;
    any_stiff = any_stiff || choice.why == MethodReason::kInconsistent ||
                (choice.why == MethodReason::kStiff && parts.nature != MethodReason::kStiff);
    island.local_error = 0.0;
    island.substeps = island.rejected = island.iterations = island.dependent_rows = 0;
    island.events = 0;
    island.unresolved_bodies = 0;
    const Method before = island.method;
    island.method = choice.method;
    island.why = choice.why;
    const bool changes_way = island.method != before || was_in_group != groups.contains(i);
    if (!changes_way && !parts.is_fresh && !has_woken) continue;
    changed = true;
    if (!parts.is_fresh && island.method != before) ++report.changes;
    parts.energy.has_changed |= !parts.is_fresh && (island.method == Method::kSequentialImpulses ||
                                                    before == Method::kSequentialImpulses);
    parts.energy.has_changed |= groups.contains(i);  // what touches exchanges energy
    const bool restarts = parts.is_fresh || has_woken;
    if (restarts) {
      restart(parts);
    } else if (parts.motion >= 0) {
      IslandMotion& motion = motions[parts.motion];
      if (before == Method::kSequentialImpulses || island.method == Method::kSequentialImpulses)
        motion.forget();
      else
        motion.change_way();
    }
    if ((restarts || before == Method::kSequentialImpulses) &&
        island.method != Method::kSequentialImpulses)
      entering.push_back(static_cast<int>(i));
  }
  if (groups.had_groups() || !groups.is_empty()) groups.list_bodies(*this, *this, sleep.awake());
  if (changed) list_by_method();
}

// with nothing of the steps before, so that a world that was saved and loaded does the same
void World::Impl::restart(const IslandParts& parts) {
  for (const int body : parts.turning_freely) rotations[body] = FreeRotation{};
  if (parts.motion >= 0) motions[parts.motion].restart();
}

// whether a joint belongs to an island that is integrated
bool World::Impl::is_integrated(std::size_t j) const {
  return islands[topology.island_of_joint(*this, j)].method != Method::kSequentialImpulses;
}

void World::Impl::list_by_method() {
  smooth_changed = true;
  carried.smooth.clear();
  carried.islands = {};
  for (const int i : sleep.awake().islands) {
    ++carried.islands[static_cast<std::size_t>(islands[i].method)];
    if (islands[i].method == Method::kSequentialImpulses) continue;
    carried.smooth.push_back(i);
  }
  carried.impulse_bodies.clear();
  carried.impulse_joints.clear();
  for (const int body : sleep.awake().bodies) {
    const int island = topology.island_of(body);
    if (island >= 0 && islands[island].method == Method::kSequentialImpulses)
      carried.impulse_bodies.push_back(body);
  }
  for (const int j : sleep.awake().joints)
    if (acts(joints[j], joint_states[j]) && !is_integrated(to_index(j)))
      carried.impulse_joints.push_back(j);
}

// Carries the smooth islands to the end of the tick; one that cannot be goes to the impulses.
void World::Impl::integrate(const StepContext& step, MethodPartition* by_method) {
  const List<int>& smooth = by_method->smooth;
  if (smooth.empty()) return;
  const StageTimer timer(clock, Stage::kIntegration, &report.stage_times);
  if (!entering.empty()) assemble_entering(joint_step(options, step.tick.start, options.time_step));
  if (smooth_changed) list_changing_courses(smooth);
  for (const int i : smooth) {
    Island& island = islands[i];
    island.local_error = 0.0;
    island.substeps = island.rejected = island.iterations = island.unresolved_bodies = 0;
    IslandParts& parts = island_parts[i];
    parts.projected_energy = parts.correction_work = 0.0;
    parts.changes = 0;
    parts.needs_method_choice = parts.has_failed = false;
    if (parts.motion >= 0) motions[parts.motion].begin_step(joint_states);
  }
  split_step(step);
  for (std::size_t k = 0; k + 1 < span_ends.size(); ++k) {
    const double t = span_ends[k];
    const JointStep span = joint_step(options, t, span_ends[k + 1] - t);
    if (!wrenches.empty() || !loads.empty()) find_loads(t, span_ends[k + 1]);
    const bool is_disturbed = had_wrenches || !loads.empty() || k > 0;
    for (const int j : time_varying_joints)
      if (is_integrated(to_index(j))) courses[j].begin(joints[j], span, joint_states[j]);
    const double since = t - step.tick.start;
    const SmoothSpan continued{t,    span.h, options.gravity, loads, courses, is_disturbed, k > 0,
                               stop, since};
    workers.run(threads_worth_it(smooth), smooth.size(), [&](std::size_t s) {
      const std::size_t i = to_index(smooth[s]);
      IslandParts& parts = island_parts[i];
      if (parts.has_failed || groups.contains(i)) return;
      if (parts.is_fresh)
        parts.has_failed = !integrate_island(i, continued.after_edit());
      else
        parts.has_failed = !integrate_island(i, continued);
    });
    for (const int i : smooth)
      if (island_parts[i].has_failed && islands[i].method != Method::kSequentialImpulses)
        refuse_island(to_index(i), MethodReason::kRefused);
    if (!groups.is_empty()) advance_contact_groups(continued);
    for (const int j : time_varying_joints)
      if (is_integrated(to_index(j))) finish_span(joints[j], span, joint_states[j]);
    had_wrenches = !loads.empty();
  }
  for (const int i : continuous.find_passing(step, *this, rollback, *this)) {
    refuse_island(to_index(i), MethodReason::kContact);
    remember_choice({Method::kSequentialImpulses, MethodReason::kContact}, true, step_count,
                    &island_parts[i]);
  }
  if (!groups.is_empty()) groups.take_out_contacts(topology, &touching);
  if (report_islands(smooth)) list_by_method();
  report.islands = by_method->islands;
}

// a thread takes tens of microseconds to wake, and is worth it for some hundreds of work
int World::Impl::threads_worth_it(const List<int>& smooth) const {
  constexpr std::size_t kBodiesWorthIt = 500;
  return smooth.size() > 1 && sleep.awake().bodies.size() >= kBodiesWorthIt ? options.threads : 1;
}

// islands that were not integrated in the step before, or were edited: what does not fit begins to
// be closed
void World::Impl::assemble_entering(const JointStep& step) {
  for (const int i : entering) {
    IslandParts& parts = island_parts[i];
    // a scene that was saved says of which joints it is known that they cannot all be met
    const bool is_known_off = islands[i].why == MethodReason::kInconsistent;
    for (const int index : parts.members.joints) {
      const std::size_t j = to_index(index);
      if (!is_known_off && is_rigid(joints[j]) &&
          !fits(joints[j], state_a(j), state_b(j), step, joint_states[j]))
        open_joint(j, step.t);
    }
    compile_if_opened(&parts);
  }
  courses.resize(joints.size());
  for (const int i : entering)
    for (const int index : island_parts[i].members.joints)
      courses[index].begin(joints[index], step, joint_states[index]);
}

// joints without axes are others for their equations once they are closed
void World::Impl::compile_where_closed(const JointStep& step) {
  for (const int index : time_varying_joints) {
    const std::size_t j = to_index(index);
    if (joint_states[j].closing || info(joints[j].kind).form != RowsForm::kPoint) continue;
    courses[j].begin(joints[j], step, joint_states[j]);
    compile_if_opened(&island_parts[topology.island_of_joint(*this, j)]);
  }
}

// or where they have been opened
void World::Impl::compile_if_opened(IslandParts* parts) {
  if (parts->motion < 0) return;
  const List<int> open_points = open_points_of(*this, joint_states, parts->members);
  if (open_points == parts->open_points) return;
  compile_island(*this, topology, open_points, parts, &motions);
  restart(*parts);
}

// joints of smooth islands that time moves, also those that stand still for now, at the end of
// their travel
void World::Impl::list_changing_courses(const List<int>& smooth) {
  smooth_changed = false;
  time_varying_joints.clear();
  for (const int i : smooth) {
    for (const int index : island_parts[i].members.joints) {
      if (joint_states[index].closing || has_moving_motor(joints[index]))
        time_varying_joints.push_back(index);
    }
  }
}

// where forces or biases jump within the step
void World::Impl::split_step(const StepContext& step) {
  span_ends.resize(2);
  span_ends[0] = step.tick.start;
  span_ends[1] = step.tick.end;
  if (wrenches.empty() && time_varying_joints.empty()) return;
  const double margin = 1e-9 * options.time_step;  // nearer to the ends is at the ends
  const auto split_at = [&](double time) {
    if (time > step.tick.start + margin && time < step.tick.end - margin) span_ends.push_back(time);
  };
  for (const Wrench& wrench : wrenches) {
    split_at(wrench.start);
    split_at(wrench.end);
  }
  for (const int j : time_varying_joints) {
    visit_motors(joints[j], joint_states[j], [&](const Motor&, double end) { split_at(end); });
    if (joint_states[j].closing) split_at(joint_states[j].closing_since + options.closing_time);
  }
  if (span_ends.size() == 2) return;
  std::sort(span_ends.begin(), span_ends.end());
  span_ends.erase(std::unique(span_ends.begin(), span_ends.end()), span_ends.end());
}

void World::Impl::find_loads(double from, double to) {
  loads.clear();
  const double middle = 0.5 * (from + to);
  for (const Wrench& wrench : wrenches)
    if (wrench.start <= middle && middle < wrench.end)
      loads.push_back({static_cast<int>(index(wrench.body)), wrench.force, wrench.torque});
}

bool World::Impl::integrate_island(std::size_t i, const SmoothSpan& span) {
  const IslandParts& parts = island_parts[i];
  for (const int body : parts.turning_freely) {
    Vector3d torque = Vector3d::Zero();
    for (const AppliedWrench& load : loads)
      if (load.body == body) torque += load.torque;
    if (!FreeRotation::turns(torque, states[body])) continue;
    if (!note(i, rotations[body].advance(span.h, torque, masses[body], accuracy_within(kInfinity),
                                         span.stop, &states[body])))
      return false;
  }
  if (parts.motion >= 0) return integrate_joints(i, span);

  const int body = parts.members.bodies.front();
  Vector3d acceleration = options.gravity;
  for (const AppliedWrench& load : loads)
    if (load.body == body) acceleration += masses[body].inverse_mass * load.force;
  integrate_ballistic(span.h, acceleration, &states[body]);
  return true;
}

// Adds to an island what an attempt came to; false where it was not done.
bool World::Impl::note(std::size_t i, const IntegrationResult& progress) {
  Island& island = islands[i];
  island.local_error += progress.local_error;
  island.substeps += static_cast<std::uint32_t>(progress.substeps);
  island.rejected += static_cast<std::uint32_t>(progress.rejected);
  island.iterations += static_cast<std::uint32_t>(progress.iterations);
  // what was not done was taken back
  if (!progress.done) return false;
  island_parts[i].projected_energy += progress.projected;
  island_parts[i].correction_work += progress.corrected;
  return true;
}

// The method of the island first. Where that fails, the other one; and where the reason is that the
// joints cannot all be met, the motion that comes nearest to it.
bool World::Impl::integrate_joints(std::size_t i, const SmoothSpan& span) {
  IslandParts& parts = island_parts[i];
  Island& island = islands[i];
  if (island.method == Method::kEventDriven) {
    const EventDriven::Surroundings around{joint_step(options, span.t, span.h), joint_states,
                                           rollback.joint_states(), masses};
    return note(i,
                motions[parts.motion].advance(span, accuracy_within(kInfinity), around, &states));
  }
  bool is_met = island.why != MethodReason::kInconsistent;
  const auto by = [&](Integration way, const IntegratorOptions& accuracy) {
    const IntegrationResult progress = advance_joints(i, way, span, accuracy);
    is_met = !progress.is_inconsistent;
    return note(i, progress);
  };
  if (is_met && island.method == Method::kRungeKutta) {
    const bool chooses = options.method == Method::kAuto;
    const double limit = chooses ? stiffness_limit(options) / options.time_step : kInfinity;
    if (by(Integration::kSubsteps, accuracy_within(limit))) return true;
    const MethodReason why =
        chooses && parts.is_stiff ? MethodReason::kStiff : MethodReason::kRefused;
    if (is_met) switch_method(i, Method::kEnergyMomentum, why);
  }
  // a jerk: what no step of ordinary length gets across, substeps may; they begin with velocities
  // that fit the joints, and what energy that takes is bounded. Steps as short as it takes need no
  // such velocities; only where these fail, too, is any energy taken, and told
  const IntegratorOptions ordinary = accuracy_within(kInfinity);
  IntegratorOptions substeps = ordinary, longer = ordinary;
  // one substep a tick, whatever its error, is asked of runge_kutta and not of what it stands in
  // for
  if (substeps.tolerance == 0.0 && options.method != Method::kRungeKutta)
    substeps.tolerance = WorldOptions{}.tolerance;
  IntegratorOptions bounded = substeps;
  bounded.most_projected = longer.most_projected = kMostProjected;
  longer.most_halvings *= 2;
  const MethodReason why = island.why;
  for (const auto& [way, accuracy] :
       {std::pair{Integration::kGradients, ordinary}, std::pair{Integration::kSubsteps, bounded},
        std::pair{Integration::kGradients, longer}, std::pair{Integration::kSubsteps, substeps}}) {
    if (!is_met) break;
    const Method method =
        way == Integration::kSubsteps ? Method::kRungeKutta : Method::kEnergyMomentum;
    if (method != island.method) switch_method(i, method, why);
    if (by(way, accuracy)) return true;
  }
  // soon after a contact it is errors left by impulses that cannot be met, which these close again
  if (is_met || step_count < parts.touched_until) return false;
  if (island.why != MethodReason::kInconsistent)
    switch_method(i, Method::kEnergyMomentum, MethodReason::kInconsistent);
  return by(Integration::kInconsistent, ordinary);
}

IntegratorOptions World::Impl::accuracy_within(double most_frequency) const {
  ImplicitMode mode = options.stiff_order == 4 ? ImplicitMode::kOrder4 : ImplicitMode::kOrder2;
  if (options.dissipation) mode = ImplicitMode::kDissipate;
  IntegratorOptions accuracy{options.order, options.tolerance, mode, most_frequency};
  const std::size_t share =
      kMostAttemptsOfAll / std::max<std::size_t>(1, sleep.awake().bodies.size());
  accuracy.most_attempts =
      static_cast<int>(std::clamp<std::size_t>(share, kLeastAttempts, kMostAttempts));
  return accuracy;
}

void World::Impl::advance_contact_groups(const SmoothSpan& part) {
  SmoothSpan span = part;
  if (span_ends.size() == 2) span.h = options.time_step;  // the whole step, however late it is
  for (std::size_t g = 0; g < groups.groups().size(); ++g) {
    const ContactGroup& group = groups.groups()[g];
    if (group.has_failed) continue;
    const IntegrationResult progress =
        groups.advance(g, span, accuracy_within(kInfinity), options, this);
    const bool is_done = note(to_index(group.islands.front()), progress);
    if (group.islands.size() > 1)  // they exchange energy
      for (const int i : group.islands) island_parts[i].energy.has_changed = true;
    if (is_done) continue;
    groups.mark_failed(g);
    for (const int i : group.islands) refuse_island(to_index(i), MethodReason::kContactsGivenUp);
  }
}

// A span in one way, and what the island learns from it.
IntegrationResult World::Impl::advance_joints(std::size_t i, Integration way,
                                              const SmoothSpan& span,
                                              const IntegratorOptions& accuracy) {
  IslandParts& parts = island_parts[i];
  IslandMotion& motion = motions[parts.motion];
  IntegrationResult progress = motion.advance(way, span, accuracy, &states);
  switch (way) {
    case Integration::kSubsteps: {
      // asked for only where it decides
      const double cost = progress.is_stiff ? gradient_cost(motion.is_simple(), parts) : 0.0;
      if (!learn_from_substeps(cost, step_count, options, &progress, &parts)) break;
      if (!progress.done) motion.begin_step(joint_states);  // forgets what it did in vain
      parts.needs_method_choice = true;
      break;
    }
    case Integration::kGradients: {
      const EnergyMomentum& method = motion.gradients();
      const int spans = method.was_first() ? 2 : 1;
      learn_from_gradients(progress.iterations / spans, method.frequency(), motion.is_simple(),
                           step_count, options, &parts);
      break;
    }
    case Integration::kInconsistent:
      if (!motion.can_be_met()) learn_from_inconsistency(step_count, &parts);
      break;
  }
  return progress;
}

// within a step
void World::Impl::switch_method(std::size_t i, Method method, MethodReason why) {
  ++island_parts[i].changes;
  islands[i].method = method;
  islands[i].why = why;
  motions[island_parts[i].motion].change_way();
  island_parts[i].needs_method_choice = true;
}

// from events to impulses
void World::Impl::hand_over(std::size_t i, MethodReason why) {
  learn_from_handover(why, step_count, options, &island_parts[i]);
  ++report.handed_over;
  if (!report.handed_over_body) report.handed_over_body = islands[i].first_body;
  tell_of_island(EventKind::kHandedOver, i);
}

// of one whose contacts are by events, where they were not
void World::Impl::take_back(std::size_t i) {
  if (island_parts[i].left_for == MethodReason::kSmooth) return;
  island_parts[i].left_for = MethodReason::kSmooth;
  tell_of_island(EventKind::kTakenBack, i);
}

void World::Impl::tell_of_island(EventKind kind, std::size_t i) {
  const List<int>& members = island_parts[i].members.bodies;
  const int second = members.size() > 1 ? members[1] : members[0];
  events.push_back({kind, time(), body_ids[members[0]], body_ids[second]});
}

// the other method takes this step, from its start, and some more
void World::Impl::refuse_island(std::size_t i, MethodReason why) {
  rollback.restore(island_parts[i].members, this);
  islands[i].method = Method::kSequentialImpulses;
  islands[i].why = why;
  island_parts[i].projected_energy = island_parts[i].correction_work = 0.0;
  if (why == MethodReason::kContactsGivenUp)
    hand_over(i, why);
  else if (why != MethodReason::kContact)
    learn_from_refusal(step_count, &island_parts[i]);
  any_refused = true;
  ++island_parts[i].changes;
  island_parts[i].energy.has_changed = true;
  report.rejected += islands[i].rejected;
}

}  // namespace constraint_sim::engine
