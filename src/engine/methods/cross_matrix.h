#pragma once

#include <Eigen/Core>

namespace constraint_sim::engine {

/// [a]×, so that [a]× b = a × b.
inline Eigen::Matrix3d cross_matrix(const Eigen::Vector3d& a) {
  Eigen::Matrix3d m;
  m << 0.0, -a.z(), a.y(), a.z(), 0.0, -a.x(), -a.y(), a.x(), 0.0;
  return m;
}

}  // namespace constraint_sim::engine
