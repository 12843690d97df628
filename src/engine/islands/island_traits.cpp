#include "engine/islands/island_traits.h"

#include <algorithm>
#include <cmath>
#include <tuple>

#include "engine/constraints/joint.h"
#include "engine/constraints/joint_kinds.h"
#include "engine/constraints/law.h"
#include "engine/constraints/one_sided_law.h"
#include "engine/methods/event_driven/joints/event_driven.h"

namespace constraint_sim::engine {
namespace {

using Eigen::Vector3d;

// Returns the largest eigenvalue of [r]ᵀ I⁻¹ [r], whose smallest eigenvalue is 0: the acceleration
// of the point r by the rotation that a force of 1 N at r causes.
double largest_response(const MassProperties& mass, const Vector3d& r) {
  Eigen::Matrix3d cross;
  cross << 0.0, -r.z(), r.y(), r.z(), 0.0, -r.x(), -r.y(), r.x(), 0.0;
  const Eigen::Matrix3d K = cross.transpose() * mass.inverse_inertia.asDiagonal() * cross;
  const double half = 0.5 * K.trace();
  const auto minor = [&](int i, int k) { return K(i, i) * K(k, k) - K(i, k) * K(k, i); };
  const double product = minor(0, 1) + minor(1, 2) + minor(2, 0);
  return half + std::sqrt(std::max(half * half - product, 0.0));
}

// Bounds the frequency ω [rad/s] at which springs move each body, and with c for k the rate [1/s]
// of its dampers. Along a line ω² ≤ 2 Σ k (1/m + λ), with λ the largest eigenvalue of [r]ᵀ I⁻¹ [r];
// about an axis n ω² ≤ 2 Σ k n·I⁻¹n. `with_limit` selects springs and dampers with a force limit
// and springs that only pull, its absence all other springs and dampers.
List<double> fastest_springs(const Model& model, const List<JointData>& joint_states,
                             const List<JointEnds>& ends, bool with_limit) {
  List<double> fastest_spring(model.bodies.size(), 0.0);
  List<double> damping;
  for (std::size_t j = 0; j < model.joints.size(); ++j) {
    if (!acts(model.joints[j], joint_states[j])) continue;
    const Joint& joint = model.joints[j];
    const auto add_to = [&](std::size_t body, double inverse_mass, double stiffness,
                            double of_damper) {
      if (damping.empty()) damping.assign(model.bodies.size(), 0.0);
      fastest_spring[body] += 2.0 * inverse_mass * stiffness;
      damping[body] += 2.0 * inverse_mass * of_damper;
    };
    const auto add_along = [&](double stiffness, double of_damper) {
      for (const auto& [body, anchor] :
           {std::pair(ends[j].first, joint.anchor_a), {ends[j].second, joint.anchor_b}})
        add_to(body, model.masses[body].inverse_mass + largest_response(model.masses[body], anchor),
               stiffness, of_damper);
    };
    const auto add_about = [&](bool is_second, double stiffness, double of_damper) {
      const bool is_fixed_in_both = forms(joint.kind).alignment == Alignment::kParallelZ;
      const Eigen::Quaterniond frame_b = joint.frame_b.value_or(Eigen::Quaterniond::Identity());
      for (const auto& [body, frame, is_fixed] :
           {std::tuple(ends[j].first, joint.frame_a, is_fixed_in_both || !is_second),
            {ends[j].second, frame_b, is_fixed_in_both || is_second}}) {
        const Vector3d& inverse = model.masses[body].inverse_inertia;
        const Vector3d n = frame * Vector3d::UnitZ();
        add_to(body, is_fixed ? n.cwiseAbs2().dot(inverse) : inverse.maxCoeff(), stiffness,
               of_damper);
      }
    };
    const SoftLaw spring = length_spring(joint);
    const bool is_limited = joint.motor.max_force > 0.0 || joint.distance.one_sided;
    if (!spring.is_none() && is_limited == with_limit) add_along(spring.K, spring.C);
    bool has_angle = false;
    for (int i = 0; i < info(joint.kind).coordinates; ++i) {
      const CoordinateLaw& of = joint.coordinates[i];
      const SoftLaw law = with_limit ? limited_servo(of) : soft_law(of);
      if (!info(joint.kind).is_angle[i]) {
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

// Number of coordinates that a law may hold anywhere, as friction does. A limit acts in one place
// only, and does not count: few limits are reached at a time.
int lasting_laws(const Joint& joint) {
  int count = joint.motor.max_force > 0.0 ? 1 : 0;
  for (const CoordinateLaw& law : joint.coordinates)
    count += law.friction > 0.0 || (law.motor && law.motor->max_force > 0.0) ? 1 : 0;
  return count;
}

// Ropes and loops beyond which a net is left to time_stepping: its ropes become taut and slack by
// turns, each time with an event. A chain of ropes has no loops, and few events.
constexpr int kMostRopesInLoops = 32, kMostLoops = 16;

}  // namespace

FastestSprings::FastestSprings(const Model& model, const List<JointData>& joint_states,
                               const List<JointEnds>& ends)
    : springs(fastest_springs(model, joint_states, ends, false)),
      limited(fastest_springs(model, joint_states, ends, true)) {}

IslandTraits traits_of(const Model& model, const IslandMembers& members,
                       const FastestSprings& fastest) {
  IslandTraits traits;
  traits.has_joints = !members.joints.empty();
  int lasting = 0, ropes = 0, loops = -static_cast<int>(members.bodies.size());
  bool is_switchable = true, breaks = false;
  for (const int j : members.joints) {
    const Joint& joint = model.joints[j];
    const auto has_coordinate = [&](auto holds) { return any_coordinate(joint, holds); };
    lasting += lasting_laws(joint);
    ropes += has_limits(joint) && if_distance(joint) != nullptr ? 1 : 0;
    loops += info(joint.kind).couples_joints ? 0 : 1;
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
  else if (lasting > static_cast<int>(EventDriven::kMostRows) ||
           (ropes > kMostRopesInLoops && loops > kMostLoops))
    traits.jumps = MethodReason::kManyRows;
  else if (breaks && traits.jumps == MethodReason::kSmooth)
    traits.jumps = MethodReason::kBreaks;
  for (const int body : members.bodies)
    for (const auto& [of_all, by_body] : {std::pair(&traits.fastest_spring, &fastest.springs),
                                          {&traits.fastest_limited, &fastest.limited}})
      *of_all = std::max(*of_all, (*by_body)[body]);
  return traits;
}

}  // namespace constraint_sim::engine
