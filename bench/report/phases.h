#pragma once

// Motions with events, in long double: integrated from event to event, in minimal coordinates that
// may change at each event.

#include <functional>
#include <vector>

#include "references.h"

namespace constraint_sim::report {

using Real = long double;
using Reals = std::vector<Real>;

/// A part of a motion without events.
struct Phase {
  std::function<Reals(const Reals& y)> rates;    ///< y'
  std::function<States(const Reals& y)> states;  ///< states of all bodies
  std::function<Real(const Reals& y)>
      until;  ///< the phase ends where this falls below 0; none: never
  std::function<Phase(const Reals& y, Reals*)> next;  ///< next phase, and its start
};

/// Returns the motion at all sample times. Steps are at most `step` [s]; bisection of a step finds
/// the end of a phase, to rounding. An event that comes and goes within a step is missed, so steps
/// have to be short.
std::function<Trajectory(int)> motion_in_phases(const Problem& problem, const Phase& first,
                                                const Reals& start, double step);

/// Free flight of all bodies under gravity, without rotation; y: positions, then velocities.
Phase flight(const Problem& problem);

/// Point masses on rods, see PlanarChain; y: angles, then rates.
Phase swing(const PlanarChain& chain);

}  // namespace constraint_sim::report
