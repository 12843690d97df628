#pragma once

#include "engine/math/list.h"
#include "engine/model/model.h"
#include "engine/model/state.h"

namespace constraint_sim::engine {

/// Energy of bodies and joints [J]: gravity is 0 at the height 0; springs count as potential.
struct Energy {
  double kinetic = 0.0, potential = 0.0;
};

Energy energy_of(const Model& model, const State& state);
Energy energy_of(const Model& model, const State& state, const List<int>& bodies,
                 const List<int>& joints);

}  // namespace constraint_sim::engine
