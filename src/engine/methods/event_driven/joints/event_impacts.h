#pragma once

#include "engine/math/list.h"
#include "engine/methods/event_driven/joints/event_motions.h"
#include "engine/methods/event_driven/joints/event_problem.h"

namespace constraint_sim::engine {

/// Limit in an impact.
struct EventHit {
  std::size_t law;
  double direction;  ///< +1 for a lower limit, −1 for an upper limit
  double rate;       ///< rate of the gap
  double restitution;
};

/// Limits that take part in the next impact: of the limits with restitution the one that is hit
/// fastest, with all others between the same two bodies; and all limits without restitution. Empty
/// where no limit is hit. `rests`: laws without restitution, since their bounces are not followed.
List<EventHit> find_hits(const EventMotions& motions, const EventProblem& problem, double t,
                         const List<char>& rests);

/// Solves an impact, with less restitution where kinetic energy would rise. Sets the impulse of
/// each hit along its law. Returns false where there is no solution.
bool solve_impact(const EventProblem& problem, const List<EventHit>& hits, List<double>* impulses);

}  // namespace constraint_sim::engine
