#pragma once

#include <Eigen/Core>
#include <optional>

#include "engine/constraints/one_sided_law.h"
#include "engine/math/list.h"
#include "engine/methods/event_driven/joints/event_motions.h"
#include "engine/methods/event_driven/joints/event_problem.h"

namespace constraint_sim::engine {

/// Held coordinate that is released, since its force has reached a bound.
struct EventRelease {
  int law = -1;
  signed char side = 0;  ///< bound: -1 lower, +1 upper
};

/// States of all laws from now on, and the accelerations of their coordinates, where laws that do
/// not act have those without one-sided forces.
struct EventDecision {
  List<OneSidedState> states;
  List<char> leaves;  ///< per law: its coordinate leaves the rate at which the law could hold it
  Eigen::VectorXd acceleration;
};

/// Decides the next states of all laws and servos at time t. A motor that follows its prescribed
/// motion moves its coordinate off a limit; where the motor is too weak for the load, the limit
/// holds. `largest_force` of the island tells rounding. Returns nothing where there is no solution.
std::optional<EventDecision> decide(const EventMotions& motions, const EventProblem& problem,
                                    double t, const EventRelease& release, double largest_force);

}  // namespace constraint_sim::engine
