#pragma once

#include "engine/dynamics/implicit/implicit_motion.h"
#include "engine/dynamics/implicit/implicit_system.h"
#include "engine/dynamics/implicit/link_in_step.h"

namespace constraint_sim::engine {

/// Adds the rows of a rod, ball joint or spring to the equations of a step, and sets the force in
/// `state`.
void evaluate_point_link(const ImplicitLink& link, const ImplicitMotion& motion,
                         const List<double>& unknowns, LinkInStep* state, ImplicitSystem* system);

}  // namespace constraint_sim::engine
