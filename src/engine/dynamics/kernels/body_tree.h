#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <array>
#include <cstddef>
#include <cstdint>

#include "engine/dynamics/island_model.h"
#include "engine/math/list.h"

namespace constraint_sim::engine {

/// Spatial vector at a point of a body, in world axes: motion (v, ω), acceleration (a, α), or a
/// force and its torque about the point.
struct SpatialVector {
  Eigen::Vector3d linear = Eigen::Vector3d::Zero(), angular = Eigen::Vector3d::Zero();

  SpatialVector operator+(const SpatialVector& other) const {
    return {linear + other.linear, angular + other.angular};
  }
  SpatialVector operator-(const SpatialVector& other) const {
    return {linear - other.linear, angular - other.angular};
  }
  SpatialVector operator*(double factor) const { return {factor * linear, factor * angular}; }
  /// Returns the power of a force at a motion.
  double dot(const SpatialVector& other) const {
    return linear.dot(other.linear) + angular.dot(other.angular);
  }
};

/// Symmetric spatial inertia that maps an acceleration to a force: the articulated inertia of a
/// body with its subtree.
struct SpatialInertia {
  /// Blocks: force by a, force by α, torque by α.
  Eigen::Matrix3d mass = Eigen::Matrix3d::Zero(), mixed = Eigen::Matrix3d::Zero(),
                  angular = Eigen::Matrix3d::Zero();

  SpatialVector operator*(const SpatialVector& a) const {
    return {mass * a.linear + mixed * a.angular,
            mixed.transpose() * a.linear + angular * a.angular};
  }
  /// Moves the reference point by the vector `by` [m].
  void shift(const Eigen::Vector3d& by);
  /// Removes u uᵀ/d for an eliminated free direction s, where u = I s and d = s·u.
  void eliminate(const SpatialVector& u, double d);
};

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
