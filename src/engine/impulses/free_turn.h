#pragma once

#include "constraint_sim/engine/body.h"
#include "engine/math/list.h"
#include "engine/model/mass_properties.h"

namespace constraint_sim::engine {

/// Rotates a body for h [s] without torque; ω of a body with three different moments changes at
/// constant L.
void advance_orientation(const MassProperties& mass, double h, BodyState* body);

/// Advances kinematic bodies: x += h v, and q by the rotation h ω.
void advance_kinematic(const List<int>& moved, double h, List<BodyState>& bodies);

}  // namespace constraint_sim::engine
