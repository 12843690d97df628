#pragma once

#include "engine/model/model.h"
#include "engine/model/state.h"

namespace constraint_sim::engine {

/// Of a gear or pulley that begins to act: throws std::invalid_argument where those that act
/// already lead from one of its coordinates to the other and contradict it.
void check_coupling_loop(const Model& model, const State& state, const Joint& joint);

}  // namespace constraint_sim::engine
