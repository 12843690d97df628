#pragma once

#include <Eigen/Core>

namespace constraint_sim::engine {

/// Returns [a]×, with [a]× b = a × b.
inline Eigen::Matrix3d cross_matrix(const Eigen::Vector3d& a) {
  Eigen::Matrix3d m;
  m << 0.0, -a.z(), a.y(), a.z(), 0.0, -a.x(), -a.y(), a.x(), 0.0;
  return m;
}

/// Returns (1 − ½ŵ)⁻¹, which maps an arm to its mean over a rotation by cay(w).
inline Eigen::Matrix3d mean_rotation(const Eigen::Vector3d& w) {
  const Eigen::Matrix3d B =
      Eigen::Matrix3d::Identity() + 0.5 * cross_matrix(w) + 0.25 * w * w.transpose();
  return B / (1.0 + 0.25 * w.squaredNorm());
}

}  // namespace constraint_sim::engine
