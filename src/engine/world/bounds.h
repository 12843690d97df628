#pragma once

#include <optional>

#include "engine/islands/sleep.h"
#include "engine/islands/step_output.h"
#include "engine/model/model.h"
#include "engine/model/state.h"

namespace constraint_sim::engine {

/// Checks the states of bodies by failure_of().
Failure failure_of_motion(const Model& model, const State& state, const List<int>& awake_bodies,
                          std::optional<BodyId>* failed_body);
/// Whether all numbers of this step that are reported or saved are finite, beside the states of the
/// bodies. Saved numbers may be no larger than loaded ones. Energies follow from these numbers.
bool are_in_bounds(const Model& model, const State& state, const AwakeSets& awake,
                   const StepOutput& output);

}  // namespace constraint_sim::engine
