#pragma once

#include <Eigen/Core>

#include "constraint_sim/engine/stop_flag.h"
#include "engine/dynamics/equations_of_motion.h"
#include "engine/math/list.h"
#include "engine/math/numbers.h"

namespace constraint_sim::engine {

// What every method that integrates an island is given:
//   IntegrationResult advance(const SmoothSpan&, const IntegratorOptions&, EquationsOfMotion*,
//   List<BodyState>*)
// carries the bodies through the span, adds impulses up in the equations, and leaves the bodies as
// they are where it cannot.

/// A span of time in which nothing jumps, and what acts in it.
struct SmoothSpan {
  double t;  ///< its start, simulated [s]
  double h;  ///< its length [s]
  const Eigen::Vector3d& gravity;
  const List<AppliedWrench>& loads;
  const List<PrescribedMotion>& courses;  ///< of all joints of the world
  bool is_disturbed;                      ///< something may have jumped since the last span
  bool is_edited;                         ///< also positions or velocities may have
  StopFlag stop = nullptr;
  double since_tick = 0.0;  ///< from the tick's start, where bodies that move by themselves are [s]

  /// The same for an island that was edited since the last step.
  SmoothSpan after_edit() const {
    return {t, h, gravity, loads, courses, true, true, stop, since_tick};
  }
};

/// What is asked of implicit steps.
enum class ImplicitMode {
  kOrder2,     ///< the midpoint rule
  kOrder4,     ///< composed; of order 2 where there are dampers, which take no steps back
  kDissipate,  ///< BDF2
};

/// How an integration is asked for, and where it is to give up.
struct IntegratorOptions {
  int order;         ///< of explicit steps, 8 or 5
  double tolerance;  ///< [m] of local error per second; 0: one substep a span
  ImplicitMode mode = ImplicitMode::kOrder4;
  /// What joints may swing bodies with before the island counts as stiff [rad/s].
  double most_frequency = kInfinity;
  /// What the start may take of the kinetic energy, as a share.
  double most_projected = kInfinity;
  int most_attempts = 50000;  ///< substeps, those in vain included, beyond which it is refused
  int most_halvings = 9;      ///< of a span, where nothing else helps implicit steps
};

}  // namespace constraint_sim::engine
