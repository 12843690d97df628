#pragma once

#include <Eigen/Core>

namespace constraint_sim::engine {

/// Linear above angular velocity, world axes [m/s, rad/s].
using Twist = Eigen::Matrix<double, 6, 1>;

inline Twist twist(const Eigen::Vector3d& linear, const Eigen::Vector3d& angular) {
  Twist both;
  both << linear, angular;
  return both;
}

}  // namespace constraint_sim::engine
