#pragma once

#include "engine/model/model.h"
#include "engine/model/state.h"

namespace constraint_sim::engine {

/// Throws std::invalid_argument where a gear or pulley that begins to act contradicts acting
/// couplings, which connect its two coordinates already.
void check_coupling_loop(const Model& model, const State& state, const Joint& joint);

}  // namespace constraint_sim::engine
