#pragma once

#include <Eigen/Core>
#include <limits>

namespace constraint_sim::engine {

/// How one scalar constraint value changes with the velocities of its two bodies:
/// Ċ = J V = j1·v_A + j2·ω_A + j3·v_B + j4·ω_B.
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

/// One scalar equation between the velocities of two bodies. Every joint, motor, limit, spring and
/// contact becomes rows; whoever solves them needs to know nothing else. The generalised force is
/// +Jᵀλ; the solver finds impulses p = hλ with
///   J V = target − softness·p,   lower ≤ p ≤ upper,
/// and beside them what corrects the error C in this step alone.
struct Row {
  int body_a = 0;  ///< index into the world's bodies; 0 is the world
  int body_b = 0;
  Jacobian J;
  double C = 0.0;       ///< value, zero where the constraint is met [m]
  double target = 0.0;  ///< what J V is driven to [m/s]: ζ, a bounce, or what closes a gap
  double drive = 0.0;   ///< share of a motor in it [m/s]
  double correction =
      0.0;  ///< what is added to close the error, in this step alone [m/s]: −(β/h) C
  double softness = 0.0;   ///< of a spring [m/(s N s)], 0 for a rigid row
  double stiffness = 0.0;  ///< of a spring [N/m]; its energy is ½ stiffness C²
  double lower = -std::numeric_limits<double>::infinity();  ///< of the impulse [N s]
  double upper = std::numeric_limits<double>::infinity();
  double impulse = 0.0;             ///< p [N s]; before solving: the guess to start from
  double correction_impulse = 0.0;  ///< of the correction [N s]; before solving: zero

  int component = -1;   ///< where the joint keeps its impulse for the next step; -1: nowhere
  int coordinate = -1;  ///< of the joint, that it acts along; -1: none

  /// Of friction, which always is this row and the next one: the row of the normal, and μ. The two
  /// impulses together are no longer than μ times that of the normal. -1: not friction. Of a row of
  /// up to four bodies, which is this one and the next: one of these.
  int normal_row = -1;
  static constexpr int kCoupled = -2, kCoupledPart = -3;
  double friction = 0.0;
};

}  // namespace constraint_sim::engine
