#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>

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
  /// Moves the reference point by the vector r = `by` [m], with [r] x = r × x: H += M [r], and
  /// J += Hᵀ [r] − [r] (H + M [r]), where M, H and J are the blocks.
  void shift(const Eigen::Vector3d& by) {
    angular += mixed.transpose().rowwise().cross(by.transpose());
    mixed += mass.rowwise().cross(by.transpose());
    angular += mixed.colwise().cross(by);
  }
  /// Removes u uᵀ/d for an eliminated free direction s, where u = I s and d = s·u.
  void eliminate(const SpatialVector& u, double d) {
    const Eigen::Vector3d linear = u.linear / d, turning = u.angular / d;
    mass -= u.linear * linear.transpose();
    mixed -= u.linear * turning.transpose();
    angular -= u.angular * turning.transpose();
  }
};

}  // namespace constraint_sim::engine
