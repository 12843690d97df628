// What follows from bodies, joints and options: islands, their equations, and which of them begin
// anew. Once after an edit, before the first stage of a step.

#include <algorithm>
#include <cmath>
#include <memory>
#include <numeric>
#include <tuple>

#include "engine/math/list.h"
#include "engine/world/world_impl.h"

namespace constraint_sim::engine {
namespace {

using Eigen::Vector3d;

// The most that a force of 1 N at r moves that point by turning the body: the largest eigenvalue of
// [r]ᵀ I⁻¹ [r], whose smallest one is 0.
double largest_response(const MassProperties& mass, const Vector3d& r) {
  Eigen::Matrix3d cross;
  cross << 0.0, -r.z(), r.y(), r.z(), 0.0, -r.x(), -r.y(), r.x(), 0.0;
  const Eigen::Matrix3d K = cross.transpose() * mass.inverse_inertia.asDiagonal() * cross;
  const double half = 0.5 * K.trace();
  const auto minor = [&](int i, int k) { return K(i, i) * K(k, k) - K(i, k) * K(k, i); };
  const double product = minor(0, 1) + minor(1, 2) + minor(2, 0);
  return half + std::sqrt(std::max(half * half - product, 0.0));
}

// what a joint that does not act no longer does
void release(JointState* state) {
  state->force = state->bias = 0.0;
  state->saturated = false;
  for (CoordinateState& coordinate : state->coordinates) coordinate.effort = coordinate.bias = 0.0;
}

}  // namespace

void World::Impl::rebuild_topology() {
  edited = false;
  seen.reset();
  model_mark = std::make_shared<const char>();

  joint_ends.clear();
  unpaired.clear();
  any_custom_forces = false;
  for (std::size_t j = 0; j < joints.size(); ++j) {
    const auto [a, b] = joint_ends.emplace_back(ends_of(joints[j]));
    if (!acts(joints[j], joint_states[j])) release(&joint_states[j]);
    any_custom_forces |= is_custom_force(joints[j].kind);
    if (!joints[j].collide_connected && acts(joints[j], joint_states[j]))
      unpaired.emplace_back(static_cast<int>(std::min(a, b)), static_cast<int>(std::max(a, b)));
  }
  std::sort(unpaired.begin(), unpaired.end());

  const auto is_gone = [this](const TouchingPair& pair) { return !is_known(pair); };
  for (List<TouchingPair>* pairs : {&touching, &resting}) {
    pairs->erase(std::remove_if(pairs->begin(), pairs->end(), is_gone), pairs->end());
    for (TouchingPair& pair : *pairs) {
      pair.a = body_index[pair.id_a.value];
      pair.b = body_index[pair.id_b.value];
    }
  }

  smooth_changed = true;
  time_varying_joints.clear();  // until the islands are sorted
  span_ends.clear();

  if (all_edited)
    for (IslandParts& parts : island_parts) static_cast<IslandMemory&>(parts) = parts.after_edit();
  if (topology_edited) {
    make_islands();
    find_loops();
  }
  list_fresh_islands();
  classify_islands();
  const double quiet = std::ceil(options.sleep_after / options.time_step);
  quiet_steps = quiet < 1e18 ? static_cast<std::uint64_t>(quiet) : 0;
  spread_waking();

  const Energy now = energy();
  largest_kinetic_energy = now.kinetic;
  reference_energy = now.kinetic + now.potential;
  begin_watch();

  states_before.resize(states.size());
  joint_states_before.resize(joint_states.size());
  memory_before.resize(island_parts.size());
}

// a loop is closed by a joint between bodies that others connect already; immovable ones are one
void World::Impl::find_loops() {
  List<bool> has_loop(islands.size(), false);
  List<std::size_t> towards(bodies.size());
  std::iota(towards.begin(), towards.end(), std::size_t{0});
  const auto root = [&](std::size_t body) {
    if (!is_movable(body)) return std::size_t{0};
    while (towards[body] != body) body = towards[body] = towards[towards[body]];
    return body;
  };
  for (std::size_t j = 0; j < joints.size(); ++j) {
    if (!acts(joints[j], joint_states[j]) || !is_always_rigid(joints[j])) continue;
    if (couples_joints(joints[j].kind)) continue;
    const auto [a, b] = joint_ends[j];
    if (root(a) == root(b))
      has_loop[island_of[is_movable(a) ? a : b]] = true;
    else
      towards[std::max(root(a), root(b))] = std::min(root(a), root(b));
  }
  is_in_loop.assign(joints.size(), false);
  for (std::size_t i = 0; i < islands.size(); ++i)
    if (has_loop[i])
      for (const int j : island_parts[i].members.joints) is_in_loop[j] = true;
}

// Islands of the same bodies and joints as before keep what is compiled for them.
void World::Impl::make_islands() {
  topology_edited = false;
  IslandLists before;
  std::swap(before, static_cast<IslandLists&>(*this));
  if (all_edited) rotations.clear();
  rotations.resize(bodies.size());
  const List<int> island_before = std::move(island_of);
  island_of.assign(bodies.size(), -1);
  for (IslandMembers& members : group_bodies(joint_ends)) {
    const auto first = to_index(members.bodies.front());
    const int old = !all_edited && first < island_before.size() ? island_before[first] : -1;
    for (const int body : members.bodies) island_of[body] = static_cast<int>(islands.size());
    if (old >= 0 && before.island_parts[old].members == members) {
      keep_island(to_index(old), &before);
      continue;
    }
    islands.push_back(new_island(members));
    IslandParts& parts = island_parts.emplace_back();
    parts.members = std::move(members);
    static_cast<IslandMemory&>(parts) = loaded_memory_of(islands.back().first_body);
  }
  loaded_memory.clear();
}

std::pair<std::size_t, std::size_t> World::Impl::ends_of(const Joint& joint) const {
  return {index(joint.body_a), index(joint.body_b)};
}

List<IslandMembers> World::Impl::group_bodies(const List<JointEnds>& ends) const {
  List<bool> movable, acting;
  for (std::size_t i = 0; i < bodies.size(); ++i) movable.push_back(is_movable(i));
  for (std::size_t j = 0; j < joints.size(); ++j)
    acting.push_back(acts(joints[j], joint_states[j]));
  return find_islands(movable, acting, ends);
}

Island World::Impl::new_island(const IslandMembers& members) const {
  Island island;
  island.first_body = body_ids[members.bodies.front()];
  island.bodies = static_cast<std::uint32_t>(members.bodies.size());
  island.joints = static_cast<std::uint32_t>(members.joints.size());
  return island;
}

IslandMemory World::Impl::loaded_memory_of(BodyId first) const {
  IslandMemory found;
  for (const auto& [first_body, memory] : loaded_memory)
    if (first_body == first) found = memory;
  return found;
}

void World::Impl::keep_island(std::size_t old, IslandLists* before) {
  islands.push_back(before->islands[old]);
  IslandParts& parts = island_parts.emplace_back(std::move(before->island_parts[old]));
  if (parts.motion < 0) return;
  const std::size_t m = to_index(parts.motion);
  parts.motion = static_cast<int>(motions.size());
  motions.push_back(std::move(before->motions[m]));
}

// those that have been edited, once it is known which bodies they have
void World::Impl::list_fresh_islands() {
  for (const BodyId id : edited_bodies) {
    if (body_index[id.value] < 0) continue;
    IslandParts& parts = island_parts[island_of[body_index[id.value]]];
    if (!parts.is_fresh) static_cast<IslandMemory&>(parts) = parts.after_edit();
    parts.is_fresh = true;
  }
  edited_bodies.clear();
  for (const BodyId id : relinked_bodies)
    if (body_index[id.value] >= 0) island_parts[island_of[body_index[id.value]]].is_stale = true;
  relinked_bodies.clear();
  if (all_edited) restart_all();
  all_edited = false;
  fresh_islands.clear();
  for (std::size_t i = 0; i < island_parts.size(); ++i)
    if (island_parts[i].is_fresh) fresh_islands.push_back(static_cast<int>(i));
}

void World::Impl::restart_all() {
  fresh_islands.resize(island_parts.size());
  std::iota(fresh_islands.begin(), fresh_islands.end(), 0);
  for (IslandParts& parts : island_parts) parts.is_fresh = true;
}

void World::Impl::classify_islands() {
  const FastestSprings fastest(*this, joint_ends);
  for (IslandParts& parts : island_parts) {
    parts.nature = classify(traits_of(parts.members, fastest), options);
    if (method_for(parts.nature, options) == Method::kSequentialImpulses) continue;
    if (parts.members.joints.empty())
      parts.turning_freely = parts.members.bodies;
    else if (parts.motion < 0 || parts.is_stale)
      compile_island(&parts);
  }
}

// Bounds the frequency ω [rad/s] at which springs move each body, and with c for k the rate [1/s]
// of its dampers. Along a line ω² ≤ 2 Σ k (1/m + λ), with λ the largest eigenvalue of [r]ᵀ I⁻¹ [r];
// about an axis n ω² ≤ 2 Σ k n·I⁻¹n. `with_limit` selects springs and dampers with a force limit,
// its absence springs and dampers without.
List<double> World::Impl::fastest_springs(const List<JointEnds>& ends, bool with_limit) const {
  List<double> fastest_spring(bodies.size(), 0.0);
  List<double> damping;
  for (std::size_t j = 0; j < joints.size(); ++j) {
    if (!acts(joints[j], joint_states[j])) continue;
    const Joint& joint = joints[j];
    const auto add_to = [&](std::size_t body, double inverse_mass, double stiffness,
                            double of_damper) {
      if (damping.empty()) damping.assign(bodies.size(), 0.0);
      fastest_spring[body] += 2.0 * inverse_mass * stiffness;
      damping[body] += 2.0 * inverse_mass * of_damper;
    };
    const auto add_along = [&](double stiffness, double of_damper) {
      for (const auto& [body, anchor] :
           {std::pair(ends[j].first, joint.anchor_a), {ends[j].second, joint.anchor_b}})
        add_to(body, masses[body].inverse_mass + largest_response(masses[body], anchor), stiffness,
               of_damper);
    };
    const auto add_about = [&](bool is_second, double stiffness, double of_damper) {
      const bool is_fixed_in_both = info(joint.kind).alignment == Alignment::kParallelZ;
      const Eigen::Quaterniond frame_b = joint.frame_b.value_or(Eigen::Quaterniond::Identity());
      for (const auto& [body, frame, is_fixed] :
           {std::tuple(ends[j].first, joint.frame_a, is_fixed_in_both || !is_second),
            {ends[j].second, frame_b, is_fixed_in_both || is_second}}) {
        const Vector3d& inverse = masses[body].inverse_inertia;
        const Vector3d n = frame * Vector3d::UnitZ();
        add_to(body, is_fixed ? n.cwiseAbs2().dot(inverse) : inverse.maxCoeff(), stiffness,
               of_damper);
      }
    };
    const SoftLaw spring = length_spring(joint);
    if (!spring.is_none() && (joint.motor.max_force > 0.0) == with_limit)
      add_along(spring.K, spring.C);
    bool has_angle = false;
    for (int i = 0; i < coordinates(joint.kind); ++i) {
      const CoordinateLaw& of = joint.coordinates[i];
      const SoftLaw law = with_limit ? limited_servo(of) : soft_law(of);
      if (!is_angle(joint.kind, i)) {
        if (law.K > 0.0 || law.C > 0.0) add_along(law.K, law.C);
        continue;
      }
      if (law.K > 0.0 || law.C > 0.0) add_about(has_angle, law.K, law.C);
      has_angle = true;
    }
  }
  for (std::size_t i = 0; i < damping.size(); ++i)
    fastest_spring[i] = std::max(std::sqrt(fastest_spring[i]), damping[i]);
  return fastest_spring;
}

IslandTraits World::Impl::traits_of(const IslandMembers& members,
                                    const FastestSprings& fastest) const {
  IslandTraits traits;
  traits.has_joints = !members.joints.empty();
  int one_sided = 0;
  bool is_switchable = true, breaks = false;
  for (const int j : members.joints) {
    const Joint& joint = joints[j];
    const auto has_coordinate = [&](auto holds) { return any_coordinate(joint, holds); };
    one_sided += has_one_sided_law(joint) ? std::max(1, coordinates(joint.kind)) : 0;
    is_switchable = is_switchable && engine::is_switchable(joint);
    breaks = breaks || joint.break_force > 0.0 || joint.break_torque > 0.0;
    if (traits.jumps != MethodReason::kSmooth) continue;
    if (has_limits(joint))
      traits.jumps = MethodReason::kLimit;
    else if (has_coordinate([](const CoordinateLaw& law) { return law.friction > 0.0; }))
      traits.jumps = MethodReason::kFriction;
    else if (joint.motor.max_force > 0.0 || has_coordinate(is_one_sided))
      traits.jumps = MethodReason::kForceLimit;
  }
  if (!is_switchable)
    traits.jumps = MethodReason::kLimitedSpring;
  else if (one_sided > static_cast<int>(EventDriven::kMostRows))
    traits.jumps = MethodReason::kManyRows;
  else if (breaks && traits.jumps == MethodReason::kSmooth)
    traits.jumps = MethodReason::kBreaks;
  for (const int body : members.bodies)
    for (const auto& [of_all, by_body] : {std::pair(&traits.fastest_spring, &fastest.springs),
                                          {&traits.fastest_limited, &fastest.limited}})
      *of_all = std::max(*of_all, (*by_body)[body]);
  return traits;
}

// joints without axes that are being closed
List<int> World::Impl::open_points_of(const IslandMembers& members) const {
  List<int> open;
  for (const int j : members.joints)
    if (joint_states[j].closing && info(joints[j].kind).form == RowsForm::kPoint) open.push_back(j);
  return open;
}

void World::Impl::compile_island(IslandParts* parts) {
  compile_island(parts, open_points_of(parts->members));
}

void World::Impl::compile_island(IslandParts* parts, const List<int>& open_points) {
  List<CoupledTerms> couplings;
  for (const int j : parts->members.joints) {
    if (!couples(joints[j].kind)) continue;
    couplings.resize(joints.size());
    couplings[j] = terms_of(to_index(j));
  }
  List<char> open;
  parts->open_points = open_points;
  for (const int j : open_points) {
    open.resize(joints.size());
    open[j] = 1;
  }
  const bool has_events = method_for(parts->nature, options) == Method::kEventDriven;
  IslandMotion motion =
      has_events ? IslandMotion(EventDriven(parts->members.joints, joints, joint_ends, couplings,
                                            masses, open))
                 : IslandMotion(EquationsOfMotion(parts->members.joints, joints, joint_ends, masses,
                                                  couplings, {}, open));
  const EquationsOfMotion& equations = motion.equations();
  const List<int>& held = equations.bodies();
  parts->turning_freely.clear();
  for (std::size_t i = equations.rotating(); i < held.size(); ++i)
    if (masses[held[i]].can_turn()) parts->turning_freely.push_back(held[i]);
  parts->is_stale = false;
  if (parts->motion >= 0) {
    motions[parts->motion] = std::move(motion);
    return;
  }
  parts->motion = static_cast<int>(motions.size());
  motions.push_back(std::move(motion));
}

}  // namespace constraint_sim::engine
