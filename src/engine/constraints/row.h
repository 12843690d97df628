#pragma once

#include <limits>

#include "engine/model/jacobian.h"

namespace constraint_sim::engine {

/// A scalar equation between the velocities of two bodies. Every joint, motor, limit, spring and
/// contact becomes rows, and the solver sees nothing else. The generalized force is +Jᵀλ; the
/// solver finds impulses p = hλ with
///   J V = target − softness·p,   lower ≤ p ≤ upper,
/// and, separately, impulses that correct the error C in this step alone.
struct Row {
  int body_a = 0;  ///< index into the world's bodies; 0: the world
  int body_b = 0;
  Jacobian J;
  double C = 0.0;           ///< value, zero where the constraint is met [m]
  double target = 0.0;      ///< target of J V [m/s]: ζ, a bounce, or the rate that closes a gap
  double drive = 0.0;       ///< part of `target` that comes from a motor [m/s]
  double correction = 0.0;  ///< rate that corrects the error in this step alone [m/s]: −(β/h) C
  double softness = 0.0;    ///< compliance of a spring [m/(s N s)], 0 for a rigid row
  /// Stiffness of a spring [N/m]; its energy is the integral over C of the force stiffness C within
  /// the bounds.
  double stiffness = 0.0;
  double lower = -std::numeric_limits<double>::infinity();  ///< lower bound of the impulse [N s]
  double upper = std::numeric_limits<double>::infinity();
  double impulse = 0.0;   ///< p [N s]; before solving: the initial guess
  double yielding = 0.0;  ///< softness of the correction alone, as a share of J M⁻¹ Jᵀ
  double correction_impulse = 0.0;  ///< impulse of the correction [N s]; before solving: zero

  /// Index at which the joint keeps the impulse for the next step; -1: not kept.
  int component = -1;
  int coordinate = -1;  ///< coordinate of the joint along which the row acts; -1: none

  /// Index of the normal row of a friction row; -1: no friction. Friction is this row and the next:
  /// the norm of both impulses is at most `friction` times the normal impulse. kCoupled and
  /// kCoupledPart mark the two rows of an equation between up to four bodies.
  int normal_row = -1;
  static constexpr int kCoupled = -2, kCoupledPart = -3;
  double friction = 0.0;
};

}  // namespace constraint_sim::engine
