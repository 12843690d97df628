#pragma once

#include "engine/collision/contact_tolerances.h"
#include "engine/methods/event_driven/contacts/contact_equations.h"

namespace constraint_sim::engine {

// Slow slips. Friction turns a slip w at a rate of μ N/(m ‖w‖), as fast as it would stop the slip.
// Where a body begins to slip or is about to stop, stages of any worthwhile length cannot follow.
// Then all slips keep their directions for a substep, held transversely by rows. With the share
// θ = f/μN of the transverse force f
//   the slip is off by θ ‖w‖ across, and friction along it is too large by μ N θ²/2,
// and both have to stay within the tolerance. Otherwise the substep is repeated as an ordinary one.

/// Sets the directions of all slips that have one.
void set_directions(const ContactTolerances& within, ContactEquations* equations);
/// Whether friction could stop a slip within h.
bool turns_fast(const ContactEquations& equations, double h);
/// Whether keeping all directions over a substep h was accurate to `tolerance` [m/s].
bool was_straight(const ContactEquations& equations, const ContactTolerances& within, double h,
                  double tolerance);

}  // namespace constraint_sim::engine
