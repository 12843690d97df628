#pragma once

#include "constraint_sim/engine/joint.h"
#include "engine/constraints/law.h"
#include "engine/math/numbers.h"
#include "engine/model/joint_data.h"

namespace constraint_sim::engine {

/// Time at which the timeout of a motor that is set now ends [s]; infinite without a timeout.
inline double end_of(const Motor& motor, double now) {
  return motor.timeout > 0.0 ? now + motor.timeout : kInfinity;
}

/// Begins the timeouts of all motors of a joint now.
inline void set_ends(const Joint& joint, double now, JointState* state) {
  visit_motors(joint, *state, [&](const Motor& motor, double& end) { end = end_of(motor, now); });
}

}  // namespace constraint_sim::engine
