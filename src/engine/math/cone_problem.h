#pragma once

#include <Eigen/Core>

#include "engine/math/list.h"

namespace constraint_sim::engine {

/// Friction of a contact of a ConeProblem.
struct ConeContact {
  double friction = 0.0;  ///< Coulomb's coefficient μ
  bool slips = false;     ///< already slips, so that its friction has a direction
  Eigen::Vector2d direction = Eigen::Vector2d::Zero();  ///< unit direction of the slip
};

/// Bounds of the impulse of a row of a ConeProblem.
struct BoundedRow {
  double least = 0.0, most = 0.0;
};

/// Contacts with Coulomb friction, a normal and two tangents each, then rows with bounds. u = b + A
/// p, and for each contact
///   u_n ≥ 0, p_n ≥ 0, one of them 0; ‖p_t‖ ≤ μ p_n, and p_t = −μ p_n u_t/‖u_t‖ where u_t ≠ 0,
///   or p_t = −μ p_n direction where it slips;
/// and for each row
///   u = 0, or p = least and u ≥ 0, or p = most and u ≤ 0.
struct ConeProblem {
  List<double> A;  ///< symmetric, positive semidefinite
  List<double> b;
  List<ConeContact> contacts;
  List<BoundedRow> rows = {};
};

}  // namespace constraint_sim::engine
