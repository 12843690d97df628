#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <array>
#include <cstddef>
#include <cstdint>

#include "engine/dynamics/island_model.h"
#include "engine/math/list.h"

namespace constraint_sim::engine {

/// A motion (v, ω) or acceleration (a, α) of the point of a body that is at some place, or a force
/// and the torque about that place; world axes.
struct SpatialVector {
  Eigen::Vector3d linear = Eigen::Vector3d::Zero(), angular = Eigen::Vector3d::Zero();

  SpatialVector operator+(const SpatialVector& other) const {
    return {linear + other.linear, angular + other.angular};
  }
  SpatialVector operator-(const SpatialVector& other) const {
    return {linear - other.linear, angular - other.angular};
  }
  SpatialVector operator*(double factor) const { return {factor * linear, factor * angular}; }
};

/// The symmetric inertia that takes an acceleration to a force; A of a body and all that hangs on
/// it.
struct SpatialInertia {
  /// Force by a, force by α, torque by α.
  Eigen::Matrix3d mass = Eigen::Matrix3d::Zero(), mixed = Eigen::Matrix3d::Zero(),
                  angular = Eigen::Matrix3d::Zero();

  SpatialVector operator*(const SpatialVector& a) const {
    return {mass * a.linear + mixed * a.angular,
            mixed.transpose() * a.linear + angular * a.angular};
  }
  /// About a place that is further by `by`.
  void shift(const Eigen::Vector3d& by);
  /// Takes out what a pivot `d` = s·u with u = I s takes of it.
  void eliminate(const SpatialVector& u, double d);
};

/// A body of a tree of joints and the joint that it hangs on; a root that hangs on nothing has six
/// free directions.
struct TreeNode {
  static constexpr std::size_t kNone = static_cast<std::size_t>(-1);

  /// What a coordinate of the joint moves: B against A, along or about this axis.
  struct Direction {
    bool turns = false;
    std::uint8_t axis = 0;     ///< 0 to 2: of A, 3: z of B, 4 to 6: of the world
    std::size_t row = kNone;   ///< that holds it
    std::size_t soft = kNone;  ///< of soft_coordinates()
    // as of the last factor()
    Eigen::Vector3d along = Eigen::Vector3d::Zero();
    SpatialVector u;     ///< I s
    double pivot = 1.0;  ///< s·I s
    double force = 0.0;  ///< along it, less what those behind ask for
  };

  std::size_t body = 0;        ///< as the state has it
  std::size_t parent = kNone;  ///< a point
  std::size_t link = kNone;
  double sense = 1.0;  ///< 1 where the body is B, else -1
  std::array<Direction, 6> directions;
  std::size_t count = 0;

  // as of the last evaluation
  /// From the centres of its bodies, or where fixed points are, to the joint's place on B [m].
  Eigen::Vector3d to_child = Eigen::Vector3d::Zero(), to_parent = Eigen::Vector3d::Zero();
  Eigen::Vector3d to_a = Eigen::Vector3d::Zero(), to_b = Eigen::Vector3d::Zero();  ///< the same
  SpatialInertia whole;  ///< with all that hangs on it, at the joint's place
  SpatialVector asked;   ///< of child against parent without its free directions
};

/// From its leaves to the root.
struct BodyTree {
  List<TreeNode> nodes;
  List<SpatialInertia> inertias;        ///< of bodies
  List<SpatialVector> forces, motions;  ///< of bodies
};

/// The bodies of an island that is a tree of joints, from its leaves to the root
///; none where it is no tree, or has what a tree cannot have.
BodyTree tree_of(const IslandModel& island);

}  // namespace constraint_sim::engine
