#pragma once

#include "constraint_sim/engine/body.h"
#include "engine/dynamics/equations_of_motion.h"
#include "engine/dynamics/interval.h"
#include "engine/math/list.h"

namespace constraint_sim::engine {

/// Returns the states of the bodies of the equations, in the order of the equations.
inline List<BodyState> states_of(const EquationsOfMotion& equations,
                                 const List<BodyState>& states) {
  List<BodyState> bodies;
  for (const int body : equations.bodies())
    bodies.push_back(states[static_cast<std::size_t>(body)]);
  return bodies;
}

/// Projects velocities that EnergyMomentum has left onto the joints, and keeps the kinetic energy.
/// The midpoint rule meets Ċ at the ends of a step to second order only: for a rod, Ċ₁ + Ċ₀ = ¼ h
/// (‖ḋ₁‖² − ‖ḋ₀‖²). The projection of v = P v + δ loses ½‖δ‖², so P v is lengthened by that energy;
/// in a free island only relative to its rigid motion, so that both momenta stay.
/// Changes nothing where joints move with time or something has jumped, where more than
/// `most_moved` of the kinetic energy would move, or more than a second order error explains.
void fit_velocities(const Interval& interval, double most_moved, EquationsOfMotion* equations,
                    List<BodyState>* states);

}  // namespace constraint_sim::engine
