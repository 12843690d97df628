#pragma once

#include <array>

#include "constraint_sim/engine/joint.h"
#include "engine/constraints/joint_kinds.h"
#include "engine/constraints/prescribed.h"
#include "engine/constraints/row.h"
#include "engine/model/joint_data.h"

namespace constraint_sim::engine {

// Laws of a free coordinate q of a joint, a translation or an angle: motors that prescribe q;
// springs, dampers and forces along its gradient; and one-sided or limited laws (limits, friction,
// motors with a force limit).

/// Force −K (q − R) − C q̇ + F of a spring, a damper, a servo and a constant force together.
struct SoftLaw {
  double K = 0.0;  ///< stiffness [N/m or N m/rad]
  double R = 0.0;  ///< rest position [m or rad]
  double C = 0.0;  ///< damping [N s/m or N m s/rad]
  double F = 0.0;  ///< constant force [N or N m]

  bool is_none() const { return K == 0.0 && C == 0.0 && F == 0.0; }
  double force(double q, double rate) const { return F - K * (q - R) - C * rate; }
};

/// Returns the soft law of a coordinate without servos that have a force limit. None where a motor
/// prescribes the coordinate, since the motor takes up any force.
SoftLaw soft_law(const CoordinateLaw& law);

/// Returns the soft law of a servo with a force limit; none without such a servo.
SoftLaw limited_servo(const CoordinateLaw& law);

/// Returns the sum of two laws as a single law about a common rest position.
SoftLaw together(const SoftLaw& a, const SoftLaw& b);

/// Returns the spring of a distance joint; none for other joints.
SoftLaw length_spring(const Joint& joint);

/// Whether the length, a coordinate or the coupling of the joint has limits, or a spring of the
/// joint only pulls.
bool has_limits(const Joint& joint);

/// Whether a motor prescribes the coordinate with any force.
inline bool is_held(const CoordinateLaw& law) {
  return law.motor && law.motor->is_rigid() && law.motor->max_force == 0.0;
}

/// Whether a motor with a force limit moves to a position, by a prescribed motion that it may lose.
inline bool may_lose_motion(const CoordinateLaw& law) {
  return law.motor && law.motor->is_rigid() && law.motor->position && law.motor->max_force > 0.0;
}

/// Whether the coordinate has a one-sided or limited law.
inline bool is_one_sided(const CoordinateLaw& law) {
  return law.is_limited() || law.friction > 0.0 || (law.motor && law.motor->max_force > 0.0);
}

/// Whether `holds` is true for a coordinate of the joint.
template <class Holds>
bool any_coordinate(const Joint& joint, Holds holds) {
  for (std::size_t i = 0; i < static_cast<std::size_t>(info(joint.kind).coordinates); ++i)
    if (holds(joint.coordinates[i])) return true;
  return false;
}

/// Calls `visit(motor, expires_at)` for each motor of the joint, with the end of its bias in
/// `state`.
template <class State, class Visit>
void visit_motors(const Joint& joint, State& state, Visit visit) {
  const auto count = static_cast<std::size_t>(info(joint.kind).coordinates);
  if (has_length(joint.kind)) visit(joint.motor, state.expires_at);
  for (std::size_t i = 0; i < count; ++i)
    if (const auto& motor = joint.coordinates[i].motor)
      visit(*motor, state.coordinates[i].expires_at);
}

/// Whether a velocity motor has a rate other than 0; `is_in_time`: its timeout is not over.
inline bool drives(const Motor& motor, bool is_in_time) {
  return motor.amplitude != 0.0 || (motor.bias != 0.0 && (motor.timeout == 0.0 || is_in_time));
}

/// Whether a motor of the joint moves its length or a coordinate.
bool has_moving_motor(const Joint& joint);

/// Returns the energy of a spring with a force limit `most` [N or N m] at elongation `stretch` [J];
/// `most` 0: no limit.
double elastic_energy(double stiffness, double stretch, double most);
/// Returns the energy of the springs of a coordinate at q [J].
double elastic_energy(const CoordinateLaw& law, double q);

/// Value, rate and Jacobian of a coordinate.
struct CoordinateMotion {
  double q = 0.0, rate = 0.0;
  Jacobian J;
};

/// Length and targets of a step for a coordinate.
struct CoordinateStep {
  double h = 0.0;       ///< length [s]
  double beta = 0.0;    ///< Baumgarte's share
  double bias = 0.0;    ///< mean rate of the motor [m/s or rad/s]
  double target = 0.0;  ///< position to be held by the motor [m or rad]
};

inline constexpr int kMaxLawRows = 4;
/// Most rows of a joint with sequential impulses, the two rows of a coupling included.
inline constexpr int kMostRowsOfJoint = kMaxJointRows + 3 * kMaxLawRows + 2;

/// Writes rows for sequential impulses: motor, soft law, nearer limit, friction; returns their
/// number. `component` is the index at which a rigid motor keeps its impulse.
int write_law_rows(const CoordinateLaw& law, const CoordinateMotion& motion,
                   const CoordinateStep& step, int component, Row* rows);

/// Returns the excess of q beyond its limits; 0 between them.
double beyond_limits(const CoordinateLaw& law, double q);

}  // namespace constraint_sim::engine
