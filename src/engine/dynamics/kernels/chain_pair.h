#pragma once

#include <array>
#include <cstddef>

#include "engine/dynamics/island_model.h"
#include "engine/math/block_pivot.h"
#include "engine/math/list.h"

namespace constraint_sim::engine {

/// Pair of points of a chain of bodies on ball joints, equally many joints from either end, side by
/// side in SIMD lanes, with their joints towards the middle. A fixed point has zeros.
struct ChainPair {
  Lanes inverse_mass;                 ///< [1/kg]
  Lanes3 inverse_inertia;             ///< principal [1/(kg m²)]
  Lanes3 anchor_to_end;               ///< anchor of the joint towards the end, body axes [m]
  Lanes3 anchor_to_middle;            ///< anchor of the joint towards the middle, body axes [m]
  std::array<std::size_t, 2> joints;  ///< joints towards the middle, indices in joints()
  Lanes sense;                        ///< 1 where end A of the joint is on the outer side, else -1
  Lanes3 arm_to_end, arm_to_middle;   ///< anchors in world axes, as of the last evaluation [m]
  BlockPivot pivot;                   ///< factors of the rows of the joints
  Lanes3 solution;  ///< forces of the joints, positive from the end towards the middle
};

/// Compiles a chain of bodies (is_chain_of_bodies()) to pairs, from its ends to the middle; see
/// chain_of_bodies.cpp.
List<ChainPair> pairs_of_chain(const IslandModel& island);

}  // namespace constraint_sim::engine
