#pragma once

#include <array>

#include "constraint_sim/engine/joint.h"
#include "constraint_sim/engine/row.h"
#include "engine/constraints/course.h"
#include "engine/constraints/joint_kinds.h"

namespace constraint_sim::engine {

// What acts on a free coordinate q of a joint, the same for a translation and an angle: a motor
// that holds it on a course, springs, dampers and forces along its gradient, and what acts one way
// or up to a limit (limits, friction, motors with a force limit), which impulses carry.

/// −K (q − R) − C q̇ + F: a spring, a damper, a servo and a constant force together.
struct SoftLaw {
  double K = 0.0;  ///< [N/m or N m/rad]
  double R = 0.0;  ///< [m or rad]
  double C = 0.0;  ///< [N s/m or N m s/rad]
  double F = 0.0;  ///< [N or N m]

  bool is_none() const { return K == 0.0 && C == 0.0 && F == 0.0; }
  double force(double q, double rate) const { return F - K * (q - R) - C * rate; }
};

/// That of a coordinate, without servos that have a force limit; none where a motor holds it, since
/// that takes up all of it.
SoftLaw soft_law(const CoordinateLaw& law);

/// That of a servo with a force limit alone; none where there is none.
SoftLaw limited_servo(const CoordinateLaw& law);

/// Both together, which act about one point.
SoftLaw together(const SoftLaw& a, const SoftLaw& b);

/// That of a length; none of a joint that has none, or is no spring.
SoftLaw length_spring(const Joint& joint);

/// Whether its length or a coordinate has limits.
bool has_limits(const Joint& joint);

/// Whether a motor holds the coordinate on its course with any force.
inline bool is_held(const CoordinateLaw& law) {
  return law.motor && law.motor->is_rigid() && law.motor->max_force == 0.0;
}

/// Whether a motor with a force limit goes to a position, on a course that it may lose.
inline bool has_course_to_lose(const CoordinateLaw& law) {
  return law.motor && law.motor->is_rigid() && law.motor->position && law.motor->max_force > 0.0;
}

/// Whether something acts one way only, or up to a limit.
inline bool is_one_sided(const CoordinateLaw& law) {
  return law.is_limited() || law.friction > 0.0 || (law.motor && law.motor->max_force > 0.0);
}

/// Whether the joint has a coordinate for which this holds.
template <class Holds>
bool any_coordinate(const Joint& joint, Holds holds) {
  for (std::size_t i = 0; i < static_cast<std::size_t>(info(joint.kind).coordinates); ++i)
    if (holds(joint.coordinates[i])) return true;
  return false;
}

/// For each motor of the joint: `visit(motor, expires_at)`, with the end of its bias in `state`.
template <class State, class Visit>
void visit_motors(const Joint& joint, State& state, Visit visit) {
  const auto count = static_cast<std::size_t>(info(joint.kind).coordinates);
  if (has_length(joint.kind)) visit(joint.motor, state.expires_at);
  for (std::size_t i = 0; i < count; ++i)
    if (const auto& motor = joint.coordinates[i].motor)
      visit(static_cast<const Motor&>(*motor), state.coordinates[i].expires_at);
}

/// Whether a motor by velocity does more than to hold; `is_in_time`: its timeout is not over.
inline bool drives(const Motor& motor, bool is_in_time) {
  return motor.amplitude != 0.0 || (motor.bias != 0.0 && (motor.timeout == 0.0 || is_in_time));
}

/// Whether a motor of the joint moves what it holds.
bool has_moving_motor(const Joint& joint);

/// What it takes to stretch a spring so far, that pulls with no more than this [J].
double elastic_energy(double stiffness, double stretch, double most);
/// Energy of the springs of a coordinate at q [J].
double elastic_energy(const CoordinateLaw& law, double q);

/// Where a coordinate is and how it moves.
struct CoordinateMotion {
  double q = 0.0, rate = 0.0;
  Jacobian J;
};

/// One step as a coordinate sees it.
struct CoordinateStep {
  double h = 0.0;       ///< [s]
  double beta = 0.0;    ///< Baumgarte's share
  double bias = 0.0;    ///< mean of the motor's [m/s or rad/s]
  double target = 0.0;  ///< where the motor is to hold it [m or rad]
};

inline constexpr int kMaxLawRows = 4;
/// For impulses.
inline constexpr int kMostRowsOfJoint = kMaxJointRows + 3 * kMaxLawRows + 2;

/// Writes rows for impulses, and returns how many: of a motor, of a soft law, of the limit that is
/// nearer, of friction. `component`: where the row of a motor that holds keeps its impulse.
int write_law_rows(const CoordinateLaw& law, const CoordinateMotion& motion,
                   const CoordinateStep& step, int component, Row* rows);

/// How far q is beyond its limits; 0 between them.
double beyond_limits(const CoordinateLaw& law, double q);

}  // namespace constraint_sim::engine
