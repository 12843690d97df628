#pragma once

#include <cstddef>
#include <cstdint>

#include "engine/islands/island_motion.h"
#include "engine/islands/islands.h"
#include "engine/islands/rollback.h"
#include "engine/math/list.h"
#include "engine/model/model.h"
#include "engine/model/state.h"

namespace constraint_sim::engine {

// Bodies of an island on joints that the last step did not resolve. Both functions return their
// number and add them to `bodies` unless null.

/// Bodies that turn too fast for impulses: by more than EnergyMomentum::kResolved in a step.
std::uint32_t find_spinning(const Model& model, const State& state, const Rollback& rollback,
                            const IslandMembers& members, List<std::size_t>* bodies);

/// Bodies that oscillate or turn too fast for energy_momentum. A body turns as fast as at either
/// end of the step, or as motors and kinematic bodies turn it: where midpoint steps lose turns of
/// a prescribed rotation, its own velocity does not tell.
std::uint32_t find_unresolved(const Model& model, const State& state, const Rollback& rollback,
                              const IslandMembers& members, const IslandMotion& motion,
                              List<std::size_t>* bodies);

}  // namespace constraint_sim::engine
