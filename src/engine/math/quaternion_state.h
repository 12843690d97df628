#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <cmath>
#include <cstddef>

#include "engine/math/numbers.h"

namespace constraint_sim::engine {

// Orientations in the state of a method: four numbers x, y, z, w.

/// Returns the rotation matrix of a quaternion of any norm; within stages the norm deviates from
/// one.
inline Eigen::Matrix3d rotation_matrix(const double* q) {
  const Eigen::Map<const Eigen::Quaterniond> quaternion(q);
  const Eigen::Matrix3d turn = quaternion.toRotationMatrix() - Eigen::Matrix3d::Identity();
  return Eigen::Matrix3d::Identity() + turn / quaternion.squaredNorm();
}

/// Writes the rate ½ (0, ω) ⊗ q.
inline void write_quaternion_rate(const Eigen::Vector3d& w, const double* q, double* rate) {
  rate[0] = 0.5 * (w.x() * q[3] + w.y() * q[2] - w.z() * q[1]);
  rate[1] = 0.5 * (w.y() * q[3] + w.z() * q[0] - w.x() * q[2]);
  rate[2] = 0.5 * (w.z() * q[3] + w.x() * q[1] - w.y() * q[0]);
  rate[3] = -0.5 * (w.x() * q[0] + w.y() * q[1] + w.z() * q[2]);
}

/// Writes q̇ = ½ q ⊗ (0, ω), with ω in the axes that q turns to.
inline void write_rate_of_rotation(const double* q, const double* w, double* rate) {
  rate[0] = 0.5 * (q[3] * w[0] + q[1] * w[2] - q[2] * w[1]);
  rate[1] = 0.5 * (q[3] * w[1] + q[2] * w[0] - q[0] * w[2]);
  rate[2] = 0.5 * (q[3] * w[2] + q[0] * w[1] - q[1] * w[0]);
  rate[3] = -0.5 * (q[0] * w[0] + q[1] * w[1] + q[2] * w[2]);
}

/// Writes the rotation vector of a small change of q, in the axes that q turns to.
inline void write_turn(const double* q, const double* change, double* turn) {
  for (int k = 0; k < 3; ++k) {
    const int i = (k + 1) % 3, j = (k + 2) % 3;
    turn[k] = 2.0 * (q[3] * change[k] - change[3] * q[k] - (q[i] * change[j] - q[j] * change[i]));
  }
}

/// Gives quaternions, one behind the other, unit length. Returns false, with some as they were,
/// where the square of a length overflows or is 0.
inline bool normalize_quaternions(double* q, std::size_t count) {
  for (const double* const end = q + 4 * count; q != end; q += 4) {
    Eigen::Map<Eigen::Vector4d> quaternion(q);
    const double square = quaternion.squaredNorm();
    if (!(square > 0.0 && square < kInfinity)) return false;
    quaternion /= std::sqrt(square);
  }
  return true;
}

}  // namespace constraint_sim::engine
