#pragma once

#include <Eigen/Core>

#include "constraint_sim/engine/row.h"
#include "engine/constraints/vectors.h"

namespace constraint_sim::engine {

// A row of a joint is C = u·v − c(t), with u and v out of the four vectors; where both are d it is
// ½ d·d. With δu = U δy the Jacobian is J = Uᵀv + Vᵀu, which is linear in each vector: at a pose it
// is ∂C/∂y, and with the means of the vectors over a step it is the discrete gradient, so that
// J(means)·step = C₁ − C₀ exactly (Gonzalez, J. Nonlinear Sci. 6 (1996) 449).

struct RowForm {
  VectorRef u, v;

  constexpr bool is_square() const { return u.kind == VectorKind::kSeparation && u == v; }
  constexpr bool is_custom() const { return u.kind == VectorKind::kCustom; }
  /// Whether the row is in metres, or in squares of these: has d.
  constexpr bool has_separation() const {
    return u.kind == VectorKind::kSeparation || v.kind == VectorKind::kSeparation || is_custom();
  }
};

/// u·v, or ½ d·d.
double value(RowForm row, const JointVectors& vectors);

/// J of (v_A, ω_A, v_B, ω_B).
Jacobian jacobian(RowForm row, const JointVectors& vectors);

/// Ċ without ċ.
double rate(RowForm row, const JointVectors& vectors, const JointMotion& motion);

/// γ = C̈ − J V̇ = β_u·v + 2 u̇·v̇ + u·β_v, without c̈.
double gamma(RowForm row, const JointVectors& vectors, const JointMotion& motion);

/// What a row does to B, and with the other sign to A, for λ = 1: a force along this, 0 of a row
/// between two axes.
Eigen::Vector3d direction(RowForm row, const JointVectors& vectors);

// The same of rows that are known to be products: methods go through these, and no look at whether
// a row is custom costs them an instruction.

double product_value(RowForm row, const JointVectors& vectors);
Jacobian product_jacobian(RowForm row, const JointVectors& vectors);
double product_rate(RowForm row, const JointVectors& vectors, const JointMotion& motion);
double product_gamma(RowForm row, const JointVectors& vectors, const JointMotion& motion);

}  // namespace constraint_sim::engine
