#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <cmath>

namespace constraint_sim {

/// Returns the smallest rotation that takes the direction of `from` to that of `to`; for opposite
/// directions half a turn about any axis across them. Eigen's FromTwoVectors gives the same
/// rotation by a singular value decomposition, which takes the compiler ten seconds in each file.
inline Eigen::Quaterniond rotation_between(const Eigen::Vector3d& from, const Eigen::Vector3d& to) {
  const auto acute = [](const Eigen::Vector3d& a, const Eigen::Vector3d& b) {
    // Cosine of half the angle, twice.
    const double twice_cosine = std::sqrt(2.0 * (1.0 + a.dot(b)));
    Eigen::Quaterniond q;
    q.w() = 0.5 * twice_cosine;
    q.vec() = a.cross(b) * (1.0 / twice_cosine);
    return q;
  };
  const Eigen::Vector3d a = from.normalized();
  const Eigen::Vector3d b = to.normalized();
  if (a.dot(b) >= 0.0) return acute(a, b);
  // a + b cancels: two turns of at most some 90 degrees, by way of the direction across a in the
  // plane of both
  Eigen::Vector3d across = b - a.dot(b) * a;
  if (across.squaredNorm() < 1e-24) across = a.unitOrthogonal();
  across.normalize();
  return acute(across, b) * acute(a, across);
}

}  // namespace constraint_sim
