#pragma once

#include <Eigen/Core>

#include "engine/constraints/joint_vectors.h"
#include "engine/model/jacobian.h"

namespace constraint_sim::engine {

// A row of a joint is C = u·v − c(t), with u and v from the four vectors of JointVectors; ½ d·d
// where both are d. With δu = U δy the Jacobian is J = Uᵀv + Vᵀu, linear in each vector. At a pose
// J is ∂C/∂y; with the means of the vectors over a step J is the discrete gradient, so that
// J(means)·step = C₁ − C₀ exactly (Gonzalez, J. Nonlinear Sci. 6 (1996) 449).

struct RowForm {
  VectorRef u, v;

  constexpr bool is_square() const { return u.kind == VectorKind::kSeparation && u == v; }
  constexpr bool is_custom() const { return u.kind == VectorKind::kCustom; }
  /// Whether the row contains d, so that its unit is m or m².
  constexpr bool has_separation() const {
    return u.kind == VectorKind::kSeparation || v.kind == VectorKind::kSeparation || is_custom();
  }
};

/// Returns u·v, or ½ d·d.
double value(RowForm row, const JointVectors& vectors);

/// Returns the Jacobian J by (v_A, ω_A, v_B, ω_B).
Jacobian jacobian(RowForm row, const JointVectors& vectors);

/// Returns Ċ without ċ.
double rate(RowForm row, const JointVectors& vectors, const JointMotion& motion);

/// Returns γ = C̈ − J V̇ = β_u·v + 2 u̇·v̇ + u·β_v, without c̈.
double gamma(RowForm row, const JointVectors& vectors, const JointMotion& motion);

/// Returns the force of a row on B for λ = 1, the opposite of the force on A; 0 for a row between
/// two axes.
Eigen::Vector3d direction(RowForm row, const JointVectors& vectors);

// Versions for rows that are known to be products. Methods use them to save the test for custom
// rows.

double product_value(RowForm row, const JointVectors& vectors);
Jacobian product_jacobian(RowForm row, const JointVectors& vectors);
double product_rate(RowForm row, const JointVectors& vectors, const JointMotion& motion);
double product_gamma(RowForm row, const JointVectors& vectors, const JointMotion& motion);

}  // namespace constraint_sim::engine
