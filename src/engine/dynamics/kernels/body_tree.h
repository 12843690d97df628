#pragma once

#include <cstddef>

#include "engine/dynamics/island_model.h"
#include "engine/dynamics/kernels/spatial_inertia.h"
#include "engine/dynamics/kernels/tree_node.h"
#include "engine/math/list.h"

namespace constraint_sim::engine {

/// Nodes from the leaves to the roots, and work space. Couplings may join several trees.
struct BodyTree {
  List<TreeNode> nodes;
  List<std::size_t> closings;           ///< links that close loops; no node has them
  List<SpatialInertia> inertias;        ///< per body
  List<SpatialVector> forces, motions;  ///< per body
  /// Whether TreeOfBodies applies: one tree without couplings, and fewer free directions than rows.
  bool has_fewer_motions = false;
};

/// Builds the trees of an island, from the leaves to the roots. Loops are cut at the joints with
/// fewest rows, and rather at joints without springs and motors; rods are in no tree. Returns an
/// empty tree where there is a joint that can neither hang nor close, or a body that only such
/// joints hold.
BodyTree tree_of(const IslandModel& island);

}  // namespace constraint_sim::engine
