#pragma once

#include "constraint_sim/engine/body.h"
#include "engine/dynamics/equations_of_motion.h"
#include "engine/dynamics/method.h"
#include "engine/math/list.h"

namespace constraint_sim::engine {

/// The bodies of the equations, in their order.
inline List<BodyState> states_of(const EquationsOfMotion& equations,
                                 const List<BodyState>& states) {
  List<BodyState> bodies;
  for (const int body : equations.bodies())
    bodies.push_back(states[static_cast<std::size_t>(body)]);
  return bodies;
}

/// Makes velocities that EnergyMomentum has left meet the joints, for what goes on from there.
///
/// The midpoint rule meets Ċ at the ends of a step to second order only: of a rod,
/// Ċ₁ + Ċ₀ = ¼ h (‖ḋ₁‖² − ‖ḋ₀‖²). The energy is that of v = P v + δ with both parts, so P v alone
/// would lose ½‖δ‖². That goes into the motion that the joints allow: P v is lengthened by it, of
/// an island that no joint holds to the world beside its motion as one body, so that both momenta
/// stay. The velocities move no further for it than P moved them: √(‖Pv‖² + ‖δ‖²) ≤ ‖Pv‖ + ‖δ‖.
///
/// Nothing changes where joints move with time or something has jumped, since there velocities have
/// other reasons not to fit, and where more than `most_moved` of the kinetic energy would move, or
/// more than a second order leaves.
void fit_velocities(const SmoothSpan& span, double most_moved, EquationsOfMotion* equations,
                    List<BodyState>* states);

}  // namespace constraint_sim::engine
