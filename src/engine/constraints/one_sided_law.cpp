#include "engine/constraints/one_sided_law.h"

#include <algorithm>
#include <cmath>

#include "engine/constraints/distance.h"
#include "engine/constraints/joint_kinds.h"
#include "engine/math/list.h"

namespace constraint_sim::engine {
namespace {

double sign(double x) { return x > 0.0 ? 1.0 : (x < 0.0 ? -1.0 : 0.0); }

bool has_one_sided_length(const Joint& joint) {
  const auto* distance = if_distance(joint);
  return distance != nullptr &&
         (distance->is_limited() || distance->one_sided || joint.motor.max_force > 0.0);
}

bool is_drive(const CoordinateLaw& law) {
  return law.motor && law.motor->is_rigid() && law.motor->max_force > 0.0;
}

// Returns the soft law beside limits, friction and drives. A motor with a constant force
// contributes the force within its limit.
SoftLaw soft_beside(const CoordinateLaw& law) {
  SoftLaw soft = soft_law(law);
  if (law.motor && law.motor->max_force > 0.0 && law.motor->force)
    soft.F = std::clamp(*law.motor->force, -law.motor->max_force, law.motor->max_force);
  return soft;
}

OneSidedLaw law_of_length(const Joint& joint) {
  const DistanceJoint& distance = joint.distance;
  OneSidedLaw law;
  law.is_distance = true;
  law.form = ScalarForm(LengthForm{});
  if (distance.is_limited()) {
    law.upper = distance.max_length;
    if (distance.min_length > 0.0) law.lower = distance.min_length;
    if (joint.motor.max_force > 0.0) law.limit_force = joint.motor.max_force;
  } else if (!distance.is_soft()) {
    law.drive = joint.motor.max_force;
  }
  if (!distance.is_soft()) return law;
  const SoftLaw spring{distance.stiffness, *distance.length, distance.damping, 0.0};
  law.servo_most = joint.motor.max_force;
  law.only_pulls = distance.one_sided;
  (law.has_servo() ? law.servo : law.soft) = spring;
  return law;
}

OneSidedLaw law_of_coupling(std::size_t index) {
  OneSidedLaw law;
  law.joint = index;
  law.is_coupling = true;
  law.upper = 0.0;
  return law;
}

CoordinateLaw with_soft_law(CoordinateLaw law, const SoftLaw& soft) {
  law.stiffness = soft.K;
  law.rest = soft.R;
  law.damping = soft.C;
  law.motor.reset();
  if (soft.F == 0.0) return law;
  law.motor.emplace();
  law.motor->force = soft.F;
  return law;
}

}  // namespace

bool has_one_sided_law(const Joint& joint) {
  return has_one_sided_length(joint) || joint.coupling.one_sided ||
         any_coordinate(joint, is_one_sided);
}

bool is_switchable(const Joint& joint) {
  const auto* distance = if_distance(joint);
  return distance == nullptr || !distance->is_soft() || !distance->is_limited() ||
         joint.motor.max_force == 0.0;
}

void add_one_sided_laws(const Joint& joint, std::size_t index, List<OneSidedLaw>* laws) {
  if (has_one_sided_length(joint)) {
    laws->push_back(law_of_length(joint));
    laws->back().joint = index;
  }
  if (joint.coupling.one_sided) laws->push_back(law_of_coupling(index));
  const JointForms& kind = forms(joint.kind);
  for (int i = 0; i < kind.coordinates; ++i) {
    const CoordinateLaw& from = joint.coordinates[static_cast<std::size_t>(i)];
    if (!is_one_sided(from)) continue;
    OneSidedLaw law;
    law.joint = index;
    law.coordinate = i;
    law.form = kind.coordinate[static_cast<std::size_t>(i)];
    law.zero = from.zero;
    law.lower = from.lower;
    law.upper = from.upper;
    law.restitution = from.limit_restitution;
    law.friction = is_held(from) ? 0.0 : from.friction;
    law.drive = is_drive(from) ? from.motor->max_force : 0.0;
    if (law.drive > 0.0) law.goal = from.motor->position;
    law.soft = soft_beside(from);
    law.servo = limited_servo(from);
    if (!law.servo.is_none()) law.servo_most = from.motor->max_force;
    law.function = kind.rows + i;
    laws->push_back(law);
  }
}

double constant_force(const OneSidedLaw& law, const OneSidedState& state) {
  double force = -law.friction * state.slip - law.drive * state.drive;
  if (state.yield != 0) force -= law.limit_force * state.yield;
  return force;
}

Prescribed rate_to_goal(double goal, double braking, double q) {
  const double off = q - goal;
  if (std::abs(off) <= kTouching) return {goal, 0.0, 0.0};  // the side is rounding
  const double side = sign(off);
  return {goal, -side * std::sqrt(2.0 * braking * std::abs(off)), side * braking};
}

ForceBounds force_bounds(const OneSidedLaw& law, Hold hold, const Prescribed& at,
                         const Prescribed& zeta) {
  ForceBounds bounds;
  const auto add = [&](double force, double above) {  // above: side of the jump of the force
    bounds.least -= above < 0.0 ? -force : force;
    bounds.most += above > 0.0 ? -force : force;
  };
  const auto side_of = [](double rate) { return std::abs(rate) > kResting ? sign(rate) : 0.0; };
  if (law.friction > 0.0) {
    if (hold == Hold::kBrake)
      add(law.friction, sign(-at.acceleration));
    else
      add(law.friction, at.rate == 0.0 ? sign(at.acceleration) : side_of(at.rate));
  }
  const bool is_driven = hold == Hold::kDrive || hold == Hold::kBrake;
  if (law.drive > 0.0) add(law.drive, is_driven ? 0.0 : side_of(at.rate - zeta.rate));
  const bool is_at_limit = hold == Hold::kUpper || hold == Hold::kLower;
  const bool is_at_both = is_at_limit && law.lower == law.upper;
  if (hold == Hold::kUpper || is_at_both) bounds.least -= law.limit_force;
  if (hold == Hold::kLower || is_at_both) bounds.most += law.limit_force;
  return bounds;
}

bool with_rows_switched(const OneSidedLaw* laws, const OneSidedState* states, std::size_t count,
                        Joint* joint) {
  bool acts = true;
  for (std::size_t k = 0; k < count; ++k) {
    const OneSidedLaw& law = laws[k];
    const bool is_rigid = states[k].hold != Hold::kNone;
    if (law.is_coupling) {
      acts = is_rigid;
      continue;
    }
    const double force = constant_force(law, states[k]);
    const double at_limit = states[k].servo == Servo::kMost    ? law.servo_most
                            : states[k].servo == Servo::kLeast ? -law.servo_most
                                                               : 0.0;
    if (!law.is_distance) {
      CoordinateLaw& of = joint->coordinates[static_cast<std::size_t>(law.coordinate)];
      if (is_held(of)) continue;
      Motor motor;
      if (states[k].hold == Hold::kDrive || states[k].hold == Hold::kBrake) motor = *of.motor;
      motor.max_force = 0.0;
      SoftLaw soft = law.soft;
      if (states[k].servo == Servo::kFollows) soft = together(soft, law.servo);
      soft.F += force + at_limit;
      of = with_soft_law(of, soft);
      if (is_rigid) of.motor = motor;
      continue;
    }
    DistanceJoint& distance = joint->distance;
    joint->motor.max_force = 0.0;
    if (is_rigid) {
      if (states[k].hold != Hold::kDrive)
        distance.length = law.limit(states[k].hold == Hold::kUpper);
      distance.frequency = distance.damping_ratio = distance.stiffness = distance.damping = 0.0;
    } else if (force != 0.0 || at_limit != 0.0) {
      joint->kind = JointKind::kFreeDistance;
      joint->coordinates[0] = with_soft_law({}, {0.0, 0.0, 0.0, force + at_limit});
    } else {
      acts = distance.is_soft() && (!law.has_servo() || states[k].servo == Servo::kFollows);
    }
  }
  return acts;
}

}  // namespace constraint_sim::engine
