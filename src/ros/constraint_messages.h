#pragma once

#include <constraint_sim/AddDistanceConstraint.h>
#include <constraint_sim/Constraint.h>

#include "constraint_sim/engine/world.h"

namespace constraint_sim {

/// Reads a constraint, whose bodies and constraints are found in the world by name. Throws
/// std::invalid_argument that names field and value, also for fields that the type does not have.
engine::Joint from_msg(const Constraint& constraint, const engine::World& world);
engine::Joint from_msg(const AddDistanceConstraintRequest& request, const engine::World& world);

}  // namespace constraint_sim
