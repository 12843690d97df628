#pragma once

#include <Eigen/Core>
#include <cstddef>

#include "engine/math/list.h"
#include "engine/math/numbers.h"

namespace constraint_sim::engine {

/// Rows between bodies, with the matrix A = J M⁻¹ Jᵀ + S as bodies and Jacobians. With u = b + A p,
/// a single row has
///   u = 0, or p = least and u ≥ 0, or p = most and u ≤ 0,
/// and a contact, its normal row before two tangents, has Coulomb's law in the form of De Saxcé and
/// Feng (Int. J. Eng. Sci. 29 (1991) 593) with the cone K = {‖p_t‖ ≤ μ p_n}:
///   K ∋ p ⊥ u + μ ‖u_t‖ n ∈ K*.
struct BodyConeProblem {
  using Twist = Eigen::Matrix<double, 6, 1>;

  /// Inertia of a body about its centre, world axes.
  struct Body {
    double mass = 1.0;          ///< [kg]
    double inverse_mass = 1.0;  ///< [1/kg]
    Eigen::Matrix3d inertia = Eigen::Matrix3d::Identity();
    Eigen::Matrix3d inverse_inertia = Eigen::Matrix3d::Identity();

    Twist apply_inverse(const Twist& J) const {
      Twist v;
      v << inverse_mass * J.head<3>(), inverse_inertia * J.tail<3>();
      return v;
    }
  };
  /// Jacobian of a row by the twist of a body, linear above angular.
  struct Part {
    int body;
    Twist J;
  };
  enum class Kind { kSingle, kNormal, kTangent };
  struct Row {
    Kind kind = Kind::kSingle;
    std::size_t parts_end =
        0;                  ///< end of its parts; the parts of the row before end where it begins
    double rate = 0.0;      ///< b, the rate without impulses
    double softness = 0.0;  ///< entry of the diagonal matrix S, single rows only
    double least = -kInfinity, most = kInfinity;  ///< bounds of p, single rows only
    double friction = 0.0;                        ///< μ, normal rows only
  };

  List<Body> bodies;
  List<Part>
      parts;  ///< at most one for each body of a row; the rows of a contact have equal bodies
  List<Row> rows;

  void clear() {
    bodies.clear();
    parts.clear();
    rows.clear();
  }
};

}  // namespace constraint_sim::engine
