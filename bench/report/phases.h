#pragma once

// Motions that change at events, in long double: integrated from event to event in minimal
// coordinates that may be others after each.

#include <functional>
#include <vector>

#include "references.h"

namespace constraint_sim::report {

using Real = long double;
using Reals = std::vector<Real>;

/// A part of a motion without events.
struct Phase {
  std::function<Reals(const Reals& y)> rates;         ///< y'
  std::function<States(const Reals& y)> states;       ///< of all bodies
  std::function<Real(const Reals& y)> until;          ///< ends where it falls below 0; none: never
  std::function<Phase(const Reals& y, Reals*)> next;  ///< what follows, and where that starts
};

/// At all sample times of the problem. Steps no longer than `step` [s]; a phase ends where
/// bisection of a step finds it, to rounding. An event that comes back within a step is passed
/// over: steps have to be short beside the time between events.
std::function<Trajectory(int)> motion_in_phases(const Problem& problem, const Phase& first,
                                                const Reals& start, double step);

/// Free flight of all bodies under gravity, without rotation: y are positions, then velocities.
Phase flight(const Problem& problem);

/// Point masses on rods as ChainRates has them; see PlanarChain. y: angles, then rates.
Phase swing(const PlanarChain& chain);

}  // namespace constraint_sim::report
