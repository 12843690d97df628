#pragma once

#include <constraint_sim/ConstraintState.h>

#include "constraint_sim/engine/world.h"

namespace constraint_sim {

/// Returns the state of a constraint after the last step. Figures that do not exist are NaN.
ConstraintState to_msg(const engine::World& world, engine::JointId id);

}  // namespace constraint_sim
