#pragma once

#include <Eigen/Core>

#include "constraint_sim/engine/stop_flag.h"
#include "engine/constraints/prescribed_motion.h"
#include "engine/dynamics/interval_inputs.h"
#include "engine/math/list.h"

namespace constraint_sim::engine {

/// Time interval without jumps, and the loads and prescribed motions in it.
struct Interval {
  double t;  ///< start, simulated time [s]
  double h;  ///< length [s]
  const Eigen::Vector3d& gravity;
  const List<AppliedWrench>& loads;
  const List<PrescribedMotion>& prescribed;  ///< one per joint of the world
  bool is_disturbed;  ///< loads or motions may have jumped since the last interval
  bool is_edited;     ///< motions, positions or velocities may have jumped as well
  StopFlag stop = nullptr;
  /// Time since the start of the tick, at which kinematic bodies are given [s].
  double since_tick = 0.0;

  /// Returns a copy of this interval for an island that was edited since the last step.
  Interval after_edit() const {
    return {t, h, gravity, loads, prescribed, true, true, stop, since_tick};
  }
};

}  // namespace constraint_sim::engine
