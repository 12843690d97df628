#pragma once

#include "constraint_sim/engine/joint.h"
#include "constraint_sim/engine/world.h"
#include "engine/model/jacobian.h"
#include "engine/model/joint_data.h"

namespace constraint_sim::engine {

// Forces and energy of joints, from the impulses of their rows.

/// Sets forces and efforts of a joint of a kind other than kDistance from the impulses per row and
/// coordinate.
void note_force(const Joint& joint, const RowVector& impulse, double h, JointState& state);

/// Adds the impulse of the row of a screw to the impulses along its coordinates.
void add_own_coupling(const Joint& joint, double impulse, RowVector* done);

/// Returns the wrench of a joint of a kind other than kDistance. `impulse` is per row and
/// coordinate, over a step of h [s].
World::JointWrench wrench_of(const Joint& joint, const BodyState& a, const BodyState& b,
                             const RowVector& impulse, double h);

/// Magnitudes that `break_force` and `break_torque` bound: [N] and [N m] of forces, [N s] and
/// [N m s] of impulses.
struct JointLoad {
  double force = 0.0, torque = 0.0;

  /// Whether `share` of the load is more than the joint bears.
  bool breaks(const Joint& joint, double share = 1.0) const {
    return (joint.break_force > 0.0 && share * force > joint.break_force) ||
           (joint.break_torque > 0.0 && share * torque > joint.break_torque);
  }
};

/// Returns the load of a joint. `rows`: forces or impulses per row and coordinate; `coupling`:
/// force or impulse of its coupling that is not part of `rows`.
JointLoad load_of(const Joint& joint, const BodyState& a, const BodyState& b, const RowVector& rows,
                  double coupling);

/// Whether a joint exerts more in a step of length `h` [s] than it bears. `impulse`: per row and
/// coordinate, its own coupling included.
bool is_overloaded(const Joint& joint, const BodyState& a, const BodyState& b,
                   const RowVector& impulse, double h, const JointState& state);

/// Returns the elastic energy of the springs of a joint [J].
double elastic_energy(const Joint& joint, const JointState& state);

/// Returns force and torque of a custom force at time t, about the centres of A and B.
Jacobian custom_wrench(const Joint& joint, const BodyState& a, const BodyState& b, double t);

}  // namespace constraint_sim::engine
