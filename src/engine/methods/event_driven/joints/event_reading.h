#pragma once

#include "constraint_sim/engine/body.h"
#include "engine/constraints/one_sided_law.h"
#include "engine/constraints/rows.h"
#include "engine/dynamics/equations_of_motion.h"
#include "engine/math/list.h"
#include "engine/methods/event_driven/joints/event_motions.h"

namespace constraint_sim::engine {

/// Bodies of the world at times of a tick; the bodies of the island are at the current time.
struct EventBodies {
  const List<BodyState>& states;
  const List<MassProperties>& masses;
  double tick_start;  ///< time of kinematic bodies [s]

  BodyState at(std::size_t body, double t) const;
};

/// Coordinate or coupling at the current state.
struct EventReading {
  double q = 0.0, rate = 0.0, acceleration = 0.0;
  Jacobian J;         ///< gradient; of a coupling the gradient of its first term
  Jacobian J_second;  ///< gradient of the second term of a coupling
};

/// Reads the coordinate or coupling of a law at time t. `equations` have counted its turns and have
/// the accelerations `rates`.
EventReading read_law(const EventMotions& motions, const EventBodies& bodies,
                      const OneSidedLaw& law, double t, const EquationsOfMotion& equations,
                      const Motions& rates);

/// Returns a coordinate as the equations have counted it up to their state, or `noted` where the
/// joint is not in the equations.
double counted_position(const EquationsOfMotion& equations, std::size_t joint, int coordinate,
                        double noted);

}  // namespace constraint_sim::engine
