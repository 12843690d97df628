#pragma once

#include <Eigen/Core>
#include <array>
#include <cstddef>
#include <cstdint>

#include "engine/dynamics/kernels/spatial_inertia.h"

namespace constraint_sim::engine {

/// Body of a tree of joints, and the joint to its parent. A root without a parent has six free
/// directions.
struct TreeNode {
  static constexpr std::size_t kNone = static_cast<std::size_t>(-1);

  /// Motion of B relative to A that a coordinate of the joint describes, along or about an axis.
  struct Direction {
    bool turns = false;
    std::uint8_t axis = 0;     ///< 0 to 2: axes of A, 3: z of B, 4 to 6: world axes
    std::size_t row = kNone;   ///< row that holds the coordinate
    std::size_t soft = kNone;  ///< index in soft_coordinates()
    // Results of the last factor().
    Eigen::Vector3d along = Eigen::Vector3d::Zero();
    SpatialVector u;     ///< I s
    double pivot = 1.0;  ///< s·I s
    double force = 0.0;  ///< along the direction, minus the demand of the subtree
  };

  std::size_t body = 0;        ///< index in the state
  std::size_t parent = kNone;  ///< index of a point
  std::size_t link = kNone;
  double sense = 1.0;  ///< 1 where the body is B, else -1
  std::array<Direction, 6> directions;
  std::size_t count = 0;

  // Results of the last evaluation.
  /// From the centres of child and parent, or the fixed point, to the place of the joint on B [m].
  Eigen::Vector3d to_child = Eigen::Vector3d::Zero(), to_parent = Eigen::Vector3d::Zero();
  /// Vectors from ends A and B to the place of the joint on B [m].
  Eigen::Vector3d to_a = Eigen::Vector3d::Zero(), to_b = Eigen::Vector3d::Zero();
  SpatialInertia whole;  ///< articulated inertia of the subtree, at the place of the joint
  /// Motion of the child relative to the parent that the rows of the joint demand: an acceleration,
  /// velocity or displacement, with none along free directions.
  SpatialVector demanded;
};

}  // namespace constraint_sim::engine
