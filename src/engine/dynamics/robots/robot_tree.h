#pragma once

#include <cstddef>

#include "engine/dynamics/island_model.h"
#include "engine/dynamics/kernels/body_tree.h"
#include "engine/dynamics/kernels/joint_tree.h"
#include "engine/dynamics/kernels/tree_node.h"
#include "engine/math/list.h"
#include "engine/model/mass_properties.h"

namespace constraint_sim::engine {

/// Joints of a robot. Lists run in parallel; motors are left out, so that all coordinates are free.
struct RobotJoints {
  List<Joint> joints;
  List<std::pair<std::size_t, std::size_t>> ends;  ///< bodies A and B, indices in the world
  List<CoupledTerms> couplings;                    ///< terms of coupling joints
};

/// Bodies and joints of a robot, compiled as trees in joint coordinates.
class RobotTree : public IslandModel {
 public:
  /// Compiles a robot. `masses`: per body of the world. `body`: the only body of a robot without
  /// joints.
  RobotTree(const RobotJoints& robot, const List<MassProperties>& masses, std::size_t body);

  /// Nodes of the bodies; empty where the joints do not form trees.
  const List<TreeNode>& nodes() const { return nodes_; }
  /// Trees in joint coordinates; empty where whole_joint_tree_of() finds none.
  const JointTree& tree() const { return tree_; }

 private:
  List<TreeNode> nodes_;
  JointTree tree_;
};

}  // namespace constraint_sim::engine
