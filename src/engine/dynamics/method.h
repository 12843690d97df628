#pragma once

#include <Eigen/Core>

#include "constraint_sim/engine/stop_flag.h"
#include "engine/dynamics/equations_of_motion.h"
#include "engine/math/list.h"
#include "engine/math/numbers.h"

namespace constraint_sim::engine {

// Interface of every method that integrates an island:
//   IntegrationResult advance(const Interval&, const IntegratorOptions&, EquationsOfMotion*,
//   List<BodyState>*)
// Advances the bodies over the interval and adds up impulses in the equations. Where the
// integration fails, RungeKutta and InconsistentMotion leave the bodies unchanged; other methods
// may have moved them.

/// Time interval without jumps, and the loads and prescribed motions in it.
struct Interval {
  double t;  ///< start, simulated time [s]
  double h;  ///< length [s]
  const Eigen::Vector3d& gravity;
  const List<AppliedWrench>& loads;
  const List<PrescribedMotion>& courses;  ///< one per joint of the world
  bool is_disturbed;  ///< loads or motions may have jumped since the last interval
  bool is_edited;     ///< motions, positions or velocities may have jumped as well
  StopFlag stop = nullptr;
  /// Time since the start of the tick, at which kinematic bodies are given [s].
  double since_tick = 0.0;

  /// Returns a copy of this interval for an island that was edited since the last step.
  Interval after_edit() const {
    return {t, h, gravity, loads, courses, true, true, stop, since_tick};
  }
};

/// Integration rule of implicit steps.
enum class ImplicitMode {
  kOrder2,  ///< midpoint rule
  kOrder4,  ///< composition of midpoint steps; order 2 with dampers, which allow no negative steps
  kDissipate,  ///< BDF2
};

/// Settings of an integration, and limits beyond which it gives up.
struct IntegratorOptions {
  int order;         ///< 8 or 5, of explicit steps
  double tolerance;  ///< local error per second [m]; 0: one substep per interval
  ImplicitMode mode = ImplicitMode::kOrder4;
  /// Frequency of bodies under joint forces beyond which the island counts as stiff [rad/s].
  double most_frequency = kInfinity;
  /// Largest share of the kinetic energy that the start may remove.
  double most_projected = kInfinity;
  /// Substeps beyond which the method gives up, rejected substeps included.
  int most_attempts = 50000;
  int most_halvings = 9;  ///< halvings of an interval by implicit steps
};

}  // namespace constraint_sim::engine
