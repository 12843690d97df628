#pragma once

#include <Eigen/Core>

namespace constraint_sim::engine {

/// Jacobian of a scalar constraint by the velocities of its two bodies: Ċ = J V = j1·v_A + j2·ω_A +
/// j3·v_B + j4·ω_B.
struct Jacobian {
  Eigen::Vector3d j1 = Eigen::Vector3d::Zero();
  Eigen::Vector3d j2 = Eigen::Vector3d::Zero();
  Eigen::Vector3d j3 = Eigen::Vector3d::Zero();
  Eigen::Vector3d j4 = Eigen::Vector3d::Zero();

  double times(const Eigen::Vector3d& v_A, const Eigen::Vector3d& w_A, const Eigen::Vector3d& v_B,
               const Eigen::Vector3d& w_B) const {
    return j1.dot(v_A) + j2.dot(w_A) + j3.dot(v_B) + j4.dot(w_B);
  }
};

}  // namespace constraint_sim::engine
