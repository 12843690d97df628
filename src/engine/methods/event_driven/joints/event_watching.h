#pragma once

#include "engine/dynamics/equations_of_motion.h"
#include "engine/math/list.h"
#include "engine/methods/event_driven/event_watch.h"
#include "engine/methods/event_driven/joints/event_motions.h"
#include "engine/methods/event_driven/joints/event_reading.h"
#include "engine/methods/event_driven/staged_substep.h"
#include "engine/methods/runge_kutta/runge_kutta.h"

namespace constraint_sim::engine {

/// Watched value of an island with joints.
struct WatchedByJoints : WatchedValue {
  int law = -1;          ///< law of the value; -1: none
  int breaks = -1;       ///< joint that breaks at the event; -1: none
  signed char side = 0;  ///< bound of a force: -1 lower, +1 upper
};

/// Longest substep that the watched values allow [s].
double longest_substep(const EventMotions& motions);

/// Lists all watched values at time t, in an order that depends only on the states of rows.
/// `motion` is at that time, by the `last` substep or at a start. Sets the accelerations of the
/// bodies.
void watch_joints(const EventMotions& motions, const EventBodies& bodies, double t,
                  const StagedSubstep& last, RungeKutta* motion, Motions* rates,
                  List<WatchedByJoints>* list);

}  // namespace constraint_sim::engine
