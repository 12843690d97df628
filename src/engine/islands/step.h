#pragma once

#include "constraint_sim/engine/stop_flag.h"
#include "constraint_sim/engine/world.h"
#include "engine/constraints/joint.h"
#include "engine/islands/assumed_paths.h"
#include "engine/islands/topology.h"
#include "engine/model/model.h"
#include "engine/support/stage_timer.h"

namespace constraint_sim::engine {

/// Simulated time of a step [s].
struct Tick {
  double start, end;
};

/// Everything that stays the same for all stages of an attempt of a step.
struct StepContext {
  const Model& model;
  const Topology& topology;
  const AssumedPaths& assumed;
  Tick tick;
  StopFlag stop = nullptr;
  Clock clock = nullptr;
};

/// Thrown inside World::step() and caught there.
struct StepFailed {
  Failure why;
};

/// Returns the interval of `h` [s] from `t` [s], with the world's settings for closing errors.
inline JointStep joint_step(const WorldOptions& options, double t, double h) {
  const bool by_baumgarte = options.method == Method::kSequentialImpulses;
  return {t, h, options.baumgarte, by_baumgarte ? 0.0 : options.closing_time};
}

}  // namespace constraint_sim::engine
