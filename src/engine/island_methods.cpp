// Which method carries which island, and the smooth ones carried: between stages 2 and 3 of a step.

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>

#include "engine/world_impl.h"

namespace constraint_sim::engine {
namespace {

using Eigen::Vector3d;

// What h ω one substep is stable up to, with some room.
constexpr double kStable8 = 5.0, kStable5 = 0.9;
// A jerk is over after a tick or two; what goes on for longer makes an island stiff.
constexpr int kStiffFor = 4;  // [spans]
// An island is no longer stiff when h ω stays below this share of the limit for so long.
constexpr double kCalmShare = 0.5;
constexpr std::uint64_t kCalmFor = 50;  // [steps]
// How long an island that could not be integrated is left to the other method [steps].
constexpr std::uint64_t kRefusedFor = 100;
// How long constraints that were inconsistent have to be consistent [steps].
constexpr std::uint64_t kInconsistentFor = 3;
// Where gradients are given up at once: substeps would cost less than this share of them.
constexpr double kMuchCheaper = 4.0;
// What a tick by gradients usually takes, and what one of Newton's iterations costs beside an
// evaluation of the equations of motion: of points on a tree of rods, and of all others.
constexpr double kUsualIterations = 15.0;
constexpr double kPointIteration = 6.0, kIteration = 20.0;
// What substeps may lose when they take over within a tick, as a share of the kinetic energy.
constexpr double kMostProjected = 1e-9;
// Substeps of an island in one span; of all bodies together; and what each has at least, so that a
// step of any number of bodies has an end.
constexpr int kMostAttempts = 50000, kLeastAttempts = 100;
constexpr std::size_t kMostAttemptsOfAll = 300000;
constexpr double kInfinity = std::numeric_limits<double>::infinity();

std::size_t at(int i) { return static_cast<std::size_t>(i); }

}  // namespace

const char* text(Why why) {
  switch (why) {
    case Why::kSmooth:
      return "smooth";
    case Why::kAskedFor:
      return "asked for";
    case Why::kContact:
      return "in contact";
    case Why::kLimit:
      return "has limits";
    case Why::kForceLimit:
      return "has a motor with a force limit";
    case Why::kFriction:
      return "has a joint with friction";
    case Why::kStiff:
      return "stiff";
    case Why::kRefused:
      return "could not be integrated to the tolerance";
    case Why::kConflict:
      return "its joints cannot all be met";
    case Why::kAtRest:
      return "at rest";
  }
  return "";
}

// ---- once after an edit

// Islands of the same bodies and joints as before keep what is compiled for them.
void World::Impl::make_islands() {
  topology_edited = false;
  std::vector<bool> movable, acting;
  for (std::size_t i = 0; i < bodies.size(); ++i) movable.push_back(is_movable(i));
  for (const JointState& state : joint_states) acting.push_back(!state.broken);

  IslandLists before;
  std::swap(before, static_cast<IslandLists&>(*this));
  if (all_edited) rotations.clear();
  rotations.resize(bodies.size());
  const std::vector<int> island_before = std::move(island_of);
  island_of.assign(bodies.size(), -1);
  for (IslandMembers& members : find_islands(movable, acting, joint_ends)) {
    const auto first = at(members.bodies.front());
    const int old = !all_edited && first < island_before.size() ? island_before[first] : -1;
    for (const int body : members.bodies) island_of[at(body)] = static_cast<int>(islands.size());
    if (old >= 0 && before.island_parts[at(old)].members == members) {
      keep_island(at(old), &before);
      continue;
    }
    Island& island = islands.emplace_back();
    island.first_body = body_ids[first];
    island.bodies = static_cast<std::uint32_t>(members.bodies.size());
    island.joints = static_cast<std::uint32_t>(members.joints.size());
    IslandParts& parts = island_parts.emplace_back();
    parts.members = std::move(members);
    for (const auto& [first_body, memory] : loaded_memory)
      if (first_body == island.first_body) static_cast<IslandMemory&>(parts) = memory;
  }
  loaded_memory.clear();
}

void World::Impl::keep_island(std::size_t old, IslandLists* before) {
  islands.push_back(before->islands[old]);
  IslandParts& parts = island_parts.emplace_back(std::move(before->island_parts[old]));
  if (parts.linked < 0) return;
  const std::size_t l = at(parts.linked);
  parts.linked = static_cast<int>(linked.size());
  linked.push_back(std::move(before->linked[l]));
  stiff.push_back(std::move(before->stiff[l]));
  inconsistent.push_back(std::move(before->inconsistent[l]));
  least_forces.push_back(std::move(before->least_forces[l]));
}

// those that have been edited, once it is known which bodies they have
void World::Impl::list_fresh_islands() {
  for (const BodyId id : edited_bodies) {
    if (body_index[id.value] < 0) continue;
    IslandParts& parts = island_parts[at(island_of[at(body_index[id.value])])];
    if (!parts.is_fresh) static_cast<IslandMemory&>(parts) = parts.after_edit();
    parts.is_fresh = true;
  }
  edited_bodies.clear();
  for (const BodyId id : relinked_bodies)
    if (body_index[id.value] >= 0)
      island_parts[at(island_of[at(body_index[id.value])])].is_stale = true;
  relinked_bodies.clear();
  if (all_edited) begin_all_anew();
  all_edited = false;
  fresh_islands.clear();
  for (std::size_t i = 0; i < island_parts.size(); ++i)
    if (island_parts[i].is_fresh) fresh_islands.push_back(static_cast<int>(i));
}

void World::Impl::begin_all_anew() {
  fresh_islands.resize(island_parts.size());
  std::iota(fresh_islands.begin(), fresh_islands.end(), 0);
  for (IslandParts& parts : island_parts) parts.is_fresh = true;
}

void World::Impl::classify_islands() {
  find_fastest_springs();
  for (IslandParts& parts : island_parts) {
    parts.nature = nature_of(parts.members);
    if (method_for(parts.nature) == Method::kSequentialImpulses) continue;
    if (parts.members.joints.empty())
      parts.turning_freely = parts.members.bodies;
    else if (parts.linked < 0 || parts.is_stale)
      link(&parts);
  }
}

// of each body, what its springs and dampers move it with: ω² ≤ 2 Σk (1/m + r²/I_min), and the same
// of c [1/s]
void World::Impl::find_fastest_springs() {
  fastest_spring.assign(bodies.size(), 0.0);
  std::vector<double> damping;
  for (std::size_t j = 0; j < joints.size(); ++j) {
    if (joint_states[j].broken) continue;
    const auto add = [&](std::size_t body, double inverse_mass, double stiffness, double c) {
      if (damping.empty()) damping.assign(bodies.size(), 0.0);
      fastest_spring[body] += 2.0 * inverse_mass * stiffness;
      damping[body] += 2.0 * inverse_mass * c;
    };
    const auto add_along = [&](std::size_t body, const Vector3d& anchor, double stiffness,
                               double c) {
      add(body,
          masses[body].inverse_mass +
              anchor.squaredNorm() * masses[body].inverse_inertia.maxCoeff(),
          stiffness, c);
    };
    const auto [a, b] = joint_ends[j];
    const Joint& joint = joints[j];
    const auto* distance = if_distance(joint);
    if (distance != nullptr && distance->is_soft()) {
      add_along(a, joint.anchor_a, distance->stiffness, distance->damping);
      add_along(b, joint.anchor_b, distance->stiffness, distance->damping);
    }
    for (int i = 0; i < coordinates(joint.kind); ++i) {
      const SoftLaw law = soft_law(joint.coordinates[at(i)]);
      if (law.K == 0.0 && law.C == 0.0) continue;
      if (!is_angle(joint.kind, i)) {  // at an arm of A that goes as far as B's anchor
        add_along(a, joint.anchor_a, law.K, law.C);
        add_along(b, joint.anchor_b, law.K, law.C);
        continue;
      }
      for (const std::size_t body : {a, b})
        add(body, masses[body].inverse_inertia.maxCoeff(), law.K, law.C);
    }
  }
  for (std::size_t i = 0; i < damping.size(); ++i)
    fastest_spring[i] = std::max(std::sqrt(fastest_spring[i]), damping[i]);
}

Why World::Impl::nature_of(const IslandMembers& members) const {
  if (options.method == Method::kSequentialImpulses) return Why::kAskedFor;
  for (const int j : members.joints) {
    const Joint& joint = joints[at(j)];
    const auto* distance = if_distance(joint);
    if (distance != nullptr && distance->is_limited()) return Why::kLimit;
    if (joint.motor.max_force > 0.0) return Why::kForceLimit;
    if (any_coordinate(joint, [](const CoordinateLaw& law) { return law.is_limited(); }))
      return Why::kLimit;
    if (any_coordinate(joint, [](const CoordinateLaw& law) { return law.friction > 0.0; }))
      return Why::kFriction;
    if (any_coordinate(joint, is_one_sided)) return Why::kForceLimit;
  }
  if (options.method == Method::kAuto)
    for (const int body : members.bodies)
      if (options.time_step * fastest_spring[at(body)] > options.stiffness_limit)
        return Why::kStiff;
  const bool is_asked = options.method == Method::kEnergyMomentum && !members.joints.empty();
  return is_asked ? Why::kAskedFor : Why::kSmooth;
}

Method World::Impl::method_for(Why why) const {
  if (why == Why::kAskedFor) return options.method;
  if (why == Why::kSmooth) return Method::kRungeKutta;
  const bool is_stiff = why == Why::kStiff || why == Why::kConflict;
  return is_stiff ? Method::kEnergyMomentum : Method::kSequentialImpulses;
}

void World::Impl::link(IslandParts* parts) {
  EquationsOfMotion equations(parts->members.joints, joints, joint_ends, masses);
  const std::vector<int>& held = equations.bodies();
  parts->turning_freely.clear();
  for (std::size_t i = equations.turning(); i < held.size(); ++i)
    if (masses[at(held[i])].can_turn()) parts->turning_freely.push_back(held[i]);
  parts->is_stale = false;
  if (parts->linked < 0) {
    parts->linked = static_cast<int>(linked.size());
    linked.emplace_back(std::move(equations));
    stiff.emplace_back();
    inconsistent.emplace_back();
    least_forces.emplace_back();
    return;
  }
  const std::size_t l = at(parts->linked);
  linked[l] = LinkedMotion(std::move(equations));
  stiff[l].reset();
  inconsistent[l].reset();
  least_forces[l].reset();
}

// ---- in every step

void World::Impl::choose_methods() {
  entering.clear();
  if (!fresh_islands.empty() || awake_changed || !touching.empty() || !touching_before.empty() ||
      any_refused || any_stiff)
    sort_islands();
  report.islands = islands_by_method;
  report.rows = integrated_rows;
}

void World::Impl::sort_islands() {
  touched.resize(islands.size());
  for (const int i : awake_islands) touched[at(i)] = false;
  for (const TouchingPair& pair : touching)
    for (const int body : {pair.a, pair.b})
      if (island_of[at(body)] >= 0) touched[at(island_of[at(body)])] = true;

  bool changed = !fresh_islands.empty() || awake_changed;
  awake_changed = any_refused = any_stiff = false;
  for (const int index : awake_islands) {
    const std::size_t i = at(index);
    Island& island = islands[i];
    IslandParts& parts = island_parts[i];
    const bool has_woken = island.why == Why::kAtRest;
    island.why = parts.nature;
    if (touched[i] && method_for(island.why) != Method::kSequentialImpulses)
      island.why = Why::kContact;
    if (step_count < parts.refused_until) {
      island.why = Why::kRefused;
      any_refused = true;
    }
    if (touched[i]) parts.touched_until = step_count + kRefusedFor;
    if (method_for(island.why) == Method::kSequentialImpulses) {
      parts.inconsistent_until = 0;
    } else if (step_count < parts.inconsistent_until) {
      island.why = Why::kConflict;
      any_stiff = true;
    } else if (parts.is_stiff && island.why == Why::kSmooth) {
      island.why = Why::kStiff;
      any_stiff = true;
    }
    island.local_error = 0.0;
    island.substeps = island.rejected = island.iterations = island.dependent_rows = 0;
    island.unresolved_bodies = 0;
    const Method before = island.method;
    island.method = method_for(island.why);
    if (island.method == before && !parts.is_fresh && !has_woken) continue;
    changed = true;
    if (!parts.is_fresh && island.method != before) ++report.changes;
    parts.energy.has_changed |= !parts.is_fresh && (island.method == Method::kSequentialImpulses ||
                                                    before == Method::kSequentialImpulses);
    const bool begins_anew = parts.is_fresh || has_woken;
    if (begins_anew) {
      begin_anew(parts);
    } else if (parts.linked >= 0) {
      linked[at(parts.linked)].forget();
      if (stiff[at(parts.linked)]) stiff[at(parts.linked)]->forget();
    }
    if ((begins_anew || before == Method::kSequentialImpulses) &&
        island.method != Method::kSequentialImpulses)
      entering.push_back(static_cast<int>(i));
  }
  if (changed) list_by_method();
}

// with nothing of the steps before, so that a world that was saved and loaded does the same
void World::Impl::begin_anew(const IslandParts& parts) {
  for (const int body : parts.turning_freely) rotations[at(body)] = FreeRotation{};
  if (parts.linked < 0) return;
  linked[at(parts.linked)].begin_anew();
  if (stiff[at(parts.linked)]) stiff[at(parts.linked)]->begin_anew();
  inconsistent[at(parts.linked)].reset();
}

// whether a joint belongs to an island that is integrated
bool World::Impl::is_integrated(std::size_t j) const {
  const auto [a, b] = joint_ends[j];
  const int island = island_of[is_movable(a) ? a : b];
  return islands[at(island)].method != Method::kSequentialImpulses;
}

void World::Impl::list_by_method() {
  smooth_changed = true;
  smooth.clear();
  islands_by_method = {};
  integrated_rows = 0;
  for (const int i : awake_islands) {
    ++islands_by_method[static_cast<std::size_t>(islands[at(i)].method)];
    if (islands[at(i)].method == Method::kSequentialImpulses) continue;
    smooth.push_back(i);
    const int l = island_parts[at(i)].linked;
    if (l >= 0) integrated_rows += static_cast<std::uint32_t>(linked[at(l)].equations().rows());
  }
  impulse_bodies.clear();
  impulse_joints.clear();
  for (const int body : awake_bodies) {
    const int island = island_of[at(body)];
    if (island >= 0 && islands[at(island)].method == Method::kSequentialImpulses)
      impulse_bodies.push_back(body);
  }
  for (const int j : awake_joints)
    if (!joint_states[at(j)].broken && !is_integrated(at(j))) impulse_joints.push_back(j);
}

void World::Impl::integrate() {
  if (smooth.empty()) return;
  const StageTimer timer(clock, Stage::kIntegration, &report.stage_times);
  enter();
  if (smooth_changed) list_changing_courses();
  for (const int i : smooth) {
    Island& island = islands[at(i)];
    island.local_error = 0.0;
    island.substeps = island.rejected = island.iterations = island.unresolved_bodies = 0;
    IslandParts& parts = island_parts[at(i)];
    parts.projected_energy = parts.correction_work = 0.0;
    parts.changes = 0;
    parts.is_to_be_asked = parts.has_failed = false;
    if (parts.linked >= 0) linked[at(parts.linked)].begin_step(joint_states);
  }
  split_step();
  for (std::size_t k = 0; k + 1 < span_ends.size(); ++k) {
    const double t = span_ends[k];
    const JointStep span = span_from(t, span_ends[k + 1] - t);
    find_loads(t, span_ends[k + 1]);
    const bool is_disturbed = had_loads || !loads.empty() || k > 0;
    for (const int j : changing_courses)
      if (is_integrated(at(j)))
        courses[at(j)] = JointCourse(joints[at(j)], span, joint_states[at(j)]);
    const SmoothSpan continued{t,       span.h,       options.gravity, loads,
                               courses, is_disturbed, k > 0,           stop};
    const SmoothSpan fresh{t, span.h, options.gravity, loads, courses, true, true, stop};
    workers.run(threads_worth_it(), smooth.size(), [&](std::size_t s) {
      const std::size_t i = at(smooth[s]);
      if (!island_parts[i].has_failed)
        island_parts[i].has_failed =
            !integrate_island(i, island_parts[i].is_fresh ? fresh : continued);
    });
    for (const int i : smooth)
      if (island_parts[at(i)].has_failed && islands[at(i)].method != Method::kSequentialImpulses)
        refuse_island(at(i));
    for (const int j : changing_courses)
      if (is_integrated(at(j))) finish_span(joints[at(j)], span, joint_states[at(j)]);
    had_loads = !loads.empty();
  }
  gather_from_islands();
  tell_of_islands();
}

// a thread takes tens of microseconds to wake, and is worth it for some hundreds of work
int World::Impl::threads_worth_it() const {
  constexpr std::size_t kBodiesWorthIt = 500;
  return smooth.size() > 1 && awake_bodies.size() >= kBodiesWorthIt ? options.threads : 1;
}

// what islands have kept to themselves, in their order, so that it is the same with any threads
void World::Impl::gather_from_islands() {
  bool any_changed = false;
  watch.integrated_corrections = 0.0;
  for (const int i : smooth) {
    const IslandParts& parts = island_parts[at(i)];
    report.projected_energy += parts.projected_energy;
    watch.integrated_corrections += parts.correction_work;
    report.changes += parts.changes;
    any_stiff = any_stiff || parts.is_to_be_asked;
    any_changed = any_changed || parts.changes > 0;
  }
  if (any_changed) list_by_method();
}

// islands that were not integrated in the step before, or were edited: what does not fit begins to
// be closed
void World::Impl::enter() {
  if (entering.empty()) return;
  const JointStep step = joint_step();
  for (const int i : entering) {
    IslandParts& parts = island_parts[at(i)];
    for (const int index : parts.members.joints) {
      const std::size_t j = at(index);
      if (is_rigid(joints[j]) && !fits(joints[j], state_a(j), state_b(j), step, joint_states[j]))
        begin_joint(joints[j], state_a(j), state_b(j), step.t, joint_states[j]);
    }
  }
  courses.resize(joints.size());
  for (const int i : entering)
    for (const int index : island_parts[at(i)].members.joints)
      courses[at(index)] = JointCourse(joints[at(index)], step, joint_states[at(index)]);
}

// joints of smooth islands that time moves, also those that stand still for now, at the end of
// their travel
void World::Impl::list_changing_courses() {
  smooth_changed = false;
  changing_courses.clear();
  for (const int i : smooth) {
    for (const int index : island_parts[at(i)].members.joints) {
      if (joint_states[at(index)].closing || has_moving_motor(joints[at(index)]))
        changing_courses.push_back(index);
    }
  }
}

// where forces or biases jump within the step
void World::Impl::split_step() {
  span_ends.assign({step_start, step_end});
  if (wrenches.empty() && changing_courses.empty()) return;
  const double margin = 1e-9 * options.time_step;  // nearer to the ends is at the ends
  const auto split_at = [&](double time) {
    if (time > step_start + margin && time < step_end - margin) span_ends.push_back(time);
  };
  for (const Wrench& wrench : wrenches) {
    split_at(wrench.start);
    split_at(wrench.end);
  }
  for (const int j : changing_courses) {
    split_at(joint_states[at(j)].expires_at);
    if (joint_states[at(j)].closing)
      split_at(joint_states[at(j)].closing_since + options.closing_time);
  }
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
  const Accuracy accuracy{options.order, options.tolerance, kInfinity,
                          kInfinity,     most_attempts,     stop};
  for (const int body : parts.turning_freely) {
    Vector3d torque = Vector3d::Zero();
    for (const Load& load : loads)
      if (load.body == body) torque += load.torque;
    if (!FreeRotation::turns(torque, states[at(body)])) continue;
    if (!note(i, rotations[at(body)].advance(span.h, torque, masses[at(body)], accuracy,
                                             &states[at(body)])))
      return false;
  }
  if (parts.linked >= 0) return integrate_joints(i, span);

  const int body = parts.members.bodies.front();
  Vector3d acceleration = options.gravity;
  for (const Load& load : loads)
    if (load.body == body) acceleration += masses[at(body)].inverse_mass * load.force;
  fall(span.h, acceleration, &states[at(body)]);
  return true;
}

// Adds to an island what an attempt came to; false where it was not done.
bool World::Impl::note(std::size_t i, const Progress& progress) {
  if (progress.substeps + progress.rejected == 0) return progress.done;
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
  bool is_met = island.why != Why::kConflict;
  const auto by_substeps = [&](double most_frequency, double most_projected) {
    const Progress progress = integrate_by_substeps(i, span, most_frequency, most_projected);
    is_met = !progress.is_inconsistent;
    return note(i, progress);
  };
  const auto by_gradients = [&](int most_halvings) {
    const Progress progress = integrate_by_gradients(i, span, most_halvings);
    is_met = !progress.is_inconsistent;
    return note(i, progress);
  };
  if (is_met && island.method == Method::kRungeKutta) {
    const bool chooses = options.method == Method::kAuto;
    const double limit = chooses ? stiffness_limit() / options.time_step : kInfinity;
    if (by_substeps(limit, kInfinity)) return true;
    const Why why = chooses && parts.is_stiff ? Why::kStiff : Why::kRefused;
    if (is_met) carry_on_with(i, Method::kEnergyMomentum, why);
  }
  if (is_met) {
    if (by_gradients(EnergyMomentum::kMostHalvings)) return true;
    // a jerk: what no step of ordinary length gets across, substeps may; they begin with velocities
    // that fit the joints, and what energy that takes is bounded, or else all that can be had
    const Why why = island.why;
    for (const double most_projected : {kMostProjected, kInfinity}) {
      if (!is_met) break;
      carry_on_with(i, Method::kRungeKutta, why);
      if (by_substeps(kInfinity, most_projected)) return true;
      if (!is_met || most_projected == kInfinity) break;
      carry_on_with(i, Method::kEnergyMomentum, why);
      if (by_gradients(2 * EnergyMomentum::kMostHalvings)) return true;
    }
  }
  // soon after a contact it is errors left by impulses that cannot be met, which these close again
  if (is_met || step_count < parts.touched_until) return false;
  if (island.why != Why::kConflict) carry_on_with(i, Method::kEnergyMomentum, Why::kConflict);
  return note(i, integrate_inconsistent(i, span));
}

// What h ω joints may swing bodies with before an island counts as stiff, or is not allowed to be
// integrated by substeps.
double World::Impl::stiffness_limit() const {
  if (options.tolerance > 0.0) return options.stiffness_limit;
  return std::min(options.stiffness_limit, options.order == 5 ? kStable5 : kStable8);
}

// The same, in rad/s, before substeps cost more than gradients. Costs are counted in evaluations of
// the equations of motion.
double World::Impl::most_frequency(std::size_t i) const {
  double limit = stiffness_limit();
  if (options.tolerance > 0.0)
    limit =
        std::max(limit, (options.order == 5 ? kStable5 : kStable8) * gradient_cost(i) / stages());
  return limit / options.time_step;
}

double World::Impl::stages() const {
  return static_cast<double>(options.order == 5 ? DormandPrince5::kStages
                                                : DormandPrince8::kStages);
}

// of a tick, as the last one was, or as such a tick usually is
double World::Impl::gradient_cost(std::size_t i) const {
  const IslandParts& parts = island_parts[i];
  const EquationsOfMotion& equations = linked[at(parts.linked)].equations();
  const bool is_simple = equations.turning() == 0 && equations.rows() <= equations.bodies().size();
  const double iterations =
      parts.gradient_iterations > 0 ? parts.gradient_iterations : kUsualIterations;
  return iterations * (is_simple ? kPointIteration : kIteration);
}

// of one island in one span: the more bodies there are, the fewer
void World::Impl::share_attempts() {
  const std::size_t share = kMostAttemptsOfAll / std::max<std::size_t>(1, awake_bodies.size());
  most_attempts = static_cast<int>(std::clamp<std::size_t>(share, kLeastAttempts, kMostAttempts));
}

Progress World::Impl::integrate_by_substeps(std::size_t i, const SmoothSpan& span,
                                            double most_frequency, double most_projected) {
  IslandParts& parts = island_parts[i];
  IslandMemory& memory = parts;
  const Accuracy accuracy{options.order,  options.tolerance, most_frequency,
                          most_projected, most_attempts,     stop};
  Progress progress = linked[at(parts.linked)].advance(span, accuracy, &states);
  if (progress.is_stiff && progress.done && options.tolerance > 0.0)
    progress.is_stiff = stages() * (progress.substeps + progress.rejected) > gradient_cost(i);
  memory.stiff_ticks = progress.is_stiff ? memory.stiff_ticks + 1 : 0;
  if (progress.done && memory.stiff_ticks < kStiffFor) return progress;
  if (!progress.done)
    linked[at(parts.linked)].begin_step(joint_states);  // forgets what it did in vain
  parts.is_to_be_asked = true;
  if (progress.done || progress.is_stiff) {
    memory.is_stiff = true;
    memory.stiff_until = step_count + kCalmFor;
  }
  return progress;
}

Progress World::Impl::integrate_by_gradients(std::size_t i, const SmoothSpan& span,
                                             int most_halvings) {
  IslandParts& parts = island_parts[i];
  IslandMemory& memory = parts;
  LinkedMotion& motion = linked[at(parts.linked)];
  std::optional<EnergyMomentum>& of_island = stiff[at(parts.linked)];
  if (!of_island) of_island.emplace(motion.equations());
  EnergyMomentum& method = *of_island;
  ImplicitMode mode = options.stiff_order == 4 ? ImplicitMode::kOrder4 : ImplicitMode::kOrder2;
  if (options.dissipation) mode = ImplicitMode::kDissipate;
  const Progress progress =
      method.advance(span, mode, options.tolerance, most_halvings, &motion.equations(), &states);
  memory.gradient_iterations = static_cast<std::uint32_t>(
      std::max(method.was_first() ? progress.iterations / 2 : progress.iterations, 1));
  if (method.frequency() > kCalmShare * most_frequency(i))
    memory.stiff_until = std::max(memory.stiff_until, step_count + kCalmFor);
  else if (method.frequency() * kMuchCheaper < most_frequency(i))
    memory.stiff_until = 0;
  memory.is_stiff = memory.is_stiff && step_count < memory.stiff_until;
  return progress;
}

// An island with inconsistent constraints stays with this method until they can be met, and a
// little longer, so that what comes and goes does not change the method in every step.
Progress World::Impl::integrate_inconsistent(std::size_t i, const SmoothSpan& span) {
  IslandParts& parts = island_parts[i];
  EquationsOfMotion& equations = linked[at(parts.linked)].equations();
  std::optional<InconsistentMotion>& method = inconsistent[at(parts.linked)];
  if (!method) method.emplace(equations);
  linked[at(parts.linked)].forget();
  if (stiff[at(parts.linked)]) stiff[at(parts.linked)]->forget();
  const Progress progress = method->advance(span, &equations, &states);
  if (!method->can_be_met()) parts.inconsistent_until = step_count + kInconsistentFor;
  return progress;
}

// within a step
void World::Impl::carry_on_with(std::size_t i, Method method, Why why) {
  ++island_parts[i].changes;
  islands[i].method = method;
  islands[i].why = why;
  linked[at(island_parts[i].linked)].forget();
  island_parts[i].is_to_be_asked = true;
}

// the other method takes this step, from its start, and some more
void World::Impl::refuse_island(std::size_t i) {
  for (const int body : island_parts[i].members.bodies) states[at(body)] = states_before[at(body)];
  for (const int j : island_parts[i].members.joints)
    joint_states[at(j)] = joint_states_before[at(j)];
  islands[i].method = Method::kSequentialImpulses;
  islands[i].why = Why::kRefused;
  island_parts[i].projected_energy = island_parts[i].correction_work = 0.0;
  island_parts[i].refused_until = step_count + kRefusedFor;
  any_refused = true;
  ++island_parts[i].changes;
  island_parts[i].energy.has_changed = true;
  report.rejected += islands[i].rejected;
}

void World::Impl::tell_of_islands() {
  report.islands = islands_by_method;
  report.rows = integrated_rows;
  for (const int index : smooth) {
    Island& island = islands[at(index)];
    const int l = island_parts[at(index)].linked;
    if (l >= 0)
      island.dependent_rows =
          static_cast<std::uint32_t>(linked[at(l)].equations().dependent_rows());
    if (island.method == Method::kEnergyMomentum && island.why != Why::kConflict)
      island.unresolved_bodies = find_unresolved(at(index), nullptr);
    report.unresolved_bodies += island.unresolved_bodies;
    report.local_error = std::max(report.local_error, island.local_error);
    report.dependent_rows = std::max(report.dependent_rows, island.dependent_rows);
    report.substeps += island.substeps;
    report.rejected += island.rejected;
    report.iterations += island.iterations;
  }
}

// how many there are in an island, and if asked for which bodies
std::uint32_t World::Impl::find_unresolved(std::size_t i, std::vector<std::size_t>* bodies) const {
  if (islands[i].method == Method::kSequentialImpulses) return find_spinning(i, bodies);
  const EnergyMomentum& method = *stiff[at(island_parts[i].linked)];
  const std::vector<int>& held = linked[at(island_parts[i].linked)].equations().bodies();
  std::uint32_t count = 0;
  for (std::size_t k = 0; k < held.size(); ++k) {
    if (options.time_step * method.frequency_of(k) <= EnergyMomentum::kResolved) continue;
    ++count;
    if (bodies != nullptr) bodies->push_back(at(held[k]));
  }
  return count;
}

// What an island's joints share where some of its rows are redundant, else none. Joints that cannot
// all be met have shares already.
const LeastNormForces* World::Impl::share_forces(const IslandParts& parts, const Island& island) {
  const EquationsOfMotion& equations = linked[at(parts.linked)].equations();
  if (equations.redundant_rows() == 0 || island.why == Why::kConflict) return nullptr;
  std::optional<LeastNormForces>& forces = least_forces[at(parts.linked)];
  if (!forces) forces.emplace(equations);
  forces->share(equations, states);
  return &*forces;
}

void World::Impl::read_smooth_joints(const JointStep& step) {
  for (const int index : changing_courses) {
    const std::size_t j = at(index);
    if (span_ends.size() > 2 && is_integrated(j))
      joint_states[j].bias = (joint_states[j].travel - joint_states_before[j].travel) / step.h;
  }
  for (const int i : smooth) {
    if (island_parts[at(i)].linked < 0) continue;
    const EquationsOfMotion& equations = linked[at(island_parts[at(i)].linked)].equations();
    const LeastNormForces* const shared = share_forces(island_parts[at(i)], islands[at(i)]);
    for (std::size_t l = 0; l < equations.joints().size(); ++l) {
      const std::size_t j = at(equations.joints()[l]);
      const double zeta = courses[j].is_driven() ? courses[j].zeta(step.t + step.h) : 0.0;
      const RowVector impulse = shared ? shared->impulse(equations, l) : equations.impulse(l);
      read_smooth_joint(joints[j], state_a(j), state_b(j), step, impulse, zeta, joint_states[j]);
      note_if_torn(j);
    }
  }
}

}  // namespace constraint_sim::engine
