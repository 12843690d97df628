#pragma once

#include "engine/math/lanes.h"

namespace constraint_sim::engine {

/// A step in the elimination L D Lᵀ of two symmetric positive definite block tridiagonal matrices
/// side by side, with blocks of 3 × 3. With S for the diagonal block after the steps before, and C
/// for the block below it,
///   S = l d lᵀ,  V = C l⁻ᵀ d⁻¹,  and C S⁻¹ Cᵀ = V d Vᵀ is subtracted from the next diagonal block
class BlockPivot {
 public:
  /// Factors S, whose lower triangle is read. Returns whether all three pivots exceed `least` times
  /// their entries of A.
  Lanes::Mask factor(const Lanes33& S, double least, const Lanes3& entries) {
    const Lanes d0 = S(0, 0);
    inverse_[0] = 1.0 / d0;
    l10_ = S(1, 0) * inverse_[0];
    l20_ = S(2, 0) * inverse_[0];
    const Lanes d1 = S(1, 1) - l10_ * S(1, 0);
    inverse_[1] = 1.0 / d1;
    const Lanes below = S(2, 1) - l20_ * S(1, 0);
    l21_ = below * inverse_[1];
    const Lanes d2 = S(2, 2) - l20_ * S(2, 0) - l21_ * below;
    inverse_[2] = 1.0 / d2;
    return (d0 > least * entries[0]) & (d1 > least * entries[1]) & (d2 > least * entries[2]);
  }

  /// Returns C S⁻¹ Cᵀ, to be subtracted from the next diagonal block; its lower triangle is valid.
  Lanes33 couple(const Lanes33& C) {
    Lanes33 W;  // C l⁻ᵀ
    W.col(0) = C.col(0);
    W.col(1) = C.col(1) - l10_ * W.col(0);
    W.col(2) = C.col(2) - l20_ * W.col(0) - l21_ * W.col(1);
    for (Eigen::Index i = 0; i < 3; ++i) V_.col(i) = inverse_[i] * W.col(i);
    return V_ * W.transpose();
  }

  /// Takes the right-hand side b; returns C S⁻¹ b, to be subtracted from the next right-hand side.
  Lanes3 reduce(const Lanes3& b) {
    reduced_[0] = b[0];
    reduced_[1] = b[1] - l10_ * reduced_[0];
    reduced_[2] = b[2] - l20_ * reduced_[0] - l21_ * reduced_[1];
    return V_ * reduced_;
  }

  /// Returns the solution of this block from the solution `next` of the next block.
  Lanes3 substitute(const Lanes3& next) const {
    Lanes3 x = inverse_.cwiseProduct(reduced_) - V_.transpose() * next;
    x[1] -= l21_ * x[2];
    x[0] -= l10_ * x[1] + l20_ * x[2];
    return x;
  }

 private:
  Lanes l10_, l20_, l21_;  // entries of l below its unit diagonal
  Lanes3 inverse_;         // inverses of the pivots d
  Lanes33 V_ = Lanes33::Constant(0.0);
  Lanes3 reduced_;  // l⁻¹ b
};

}  // namespace constraint_sim::engine
