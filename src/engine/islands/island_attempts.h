#pragma once

#include <cstddef>

#include "engine/dynamics/integrator_options.h"
#include "engine/dynamics/interval.h"
#include "engine/islands/island_lists.h"
#include "engine/islands/rollback.h"
#include "engine/islands/sleep.h"
#include "engine/islands/step.h"
#include "engine/islands/step_output.h"
#include "engine/math/integrate.h"
#include "engine/model/state.h"

namespace constraint_sim::engine {

/// Everything that the integration of islands reads and writes in a step beside its own fields.
struct IntegrationStep {
  const StepContext& step;
  const Model& model;
  const Topology& topology;
  const AwakeSets& awake;
  const Rollback& rollback;
  State* state;
  IslandLists* lists;
  StepOutput* output;
};

/// Options of an integration. The limit on substeps falls with the number of awake bodies.
/// `most_frequency`: frequency from which an island is stiff [rad/s].
IntegratorOptions integrator_options(const IntegrationStep& in, double most_frequency);

/// Adds the results of an attempt to the report of an island; false where the attempt failed.
bool add_result(IslandLists* lists, std::size_t i, const IntegrationResult& progress);

/// Advances an island with joints by an interval. The method of the island is tried first; where it
/// fails, the other method; and where the joints cannot all be met, the motion that comes nearest
/// to meeting them. False where every method fails.
bool integrate_joints(const IntegrationStep& in, std::size_t i, const Interval& interval);

}  // namespace constraint_sim::engine
