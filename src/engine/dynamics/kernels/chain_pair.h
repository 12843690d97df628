#pragma once

#include <array>
#include <cstddef>

#include "engine/dynamics/island_model.h"
#include "engine/math/block_pivot.h"
#include "engine/math/list.h"

namespace constraint_sim::engine {

/// Of a chain of bodies on ball joints, the two as many joints from either end, side by side, and
/// the joints from them towards the middle. An end that is no body has zeros.
struct ChainPair {
  Lanes inverse_mass;                 ///< [1/kg]
  Lanes3 inverse_inertia;             ///< principal [1/(kg m²)]
  Lanes3 anchor_to_end;               ///< of the joint there, in the body [m]
  Lanes3 anchor_to_middle;            ///< the same
  std::array<std::size_t, 2> joints;  ///< those towards the middle, as joints()
  Lanes sense;                        ///< 1 where their A is on the side of the end, else -1
  Lanes3 arm_to_end, arm_to_middle;   ///< anchors in world axes, as of the last evaluation [m]
  BlockPivot pivot;                   ///< of the joints' rows
  Lanes3 solution;                    ///< of these, positive from the end towards the middle
};

/// Of an island of which is_chain_of_bodies() holds, from its ends to the middle
/// (chain_of_bodies.cpp).
List<ChainPair> pairs_of_chain(const IslandModel& island);

}  // namespace constraint_sim::engine
