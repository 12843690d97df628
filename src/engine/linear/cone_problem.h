#pragma once

#include <Eigen/Core>
#include <limits>
#include <vector>

#include "constraint_sim/engine/stop_flag.h"

namespace constraint_sim::engine {

/// How a contact of a ConeProblem acts.
struct ConeContact {
  double friction = 0.0;  ///< μ
  bool slips = false;     ///< already, so that its friction has a direction
  Eigen::Vector2d direction = Eigen::Vector2d::Zero();  ///< unit, of the slip
};

/// Between which bounds a row of a ConeProblem acts.
struct BoundedRow {
  double least = 0.0, most = 0.0;
};

/// Contacts with Coulomb's friction: three numbers each, along the normal and two tangents; then
/// rows with bounds, one number each. u = b + A p, and for each contact
///   u_n ≥ 0, p_n ≥ 0, one of them 0; ‖p_t‖ ≤ μ p_n, and p_t = −μ p_n u_t/‖u_t‖ where u_t ≠ 0,
///   or of one that slips p_t = −μ p_n times its direction;
/// and for each row
///   u = 0, or p at the least and u ≥ 0, or p at the most and u ≤ 0.
struct ConeProblem {
  Eigen::MatrixXd A;  ///< symmetric, positive semidefinite
  Eigen::VectorXd b;
  std::vector<ConeContact> contacts;
  std::vector<BoundedRow> rows = {};
};

/// What solve() may do, and has done. The unit is a substep of one body
/// with one contact, 7 µs.
struct SolveEffort {
  double most = std::numeric_limits<double>::infinity();
  StopFlag stop = nullptr;
  double spent = 0.0;

  bool is_over() const { return spent > most || is_set(stop); }
};

/// Solves it by Newton's method on which contacts are open, stick and slip (Alart and Curnier,
/// Comput. Methods Appl. Mech. Eng. 92 (1991) 353), begun from sweeps over the contacts, each
/// solved exactly (Jean, Comput. Methods Appl. Mech. Eng. 177 (1999) 235), and over the rows. Where
/// A is singular p is about the one of least norm, rates of each contact scaled to a trace of 3 of
/// its A. False where it does not get there: it has no solution, or friction and many contacts make
/// it take too long, or `effort` is over. Takes a residual of rounding for none.
bool solve(const ConeProblem& problem, Eigen::VectorXd* p, SolveEffort* effort);

/// The impulse of one contact on its own: A of 3×3, b of 3. False where no impulse along the normal
/// moves it along the normal.
bool solve_contact(const Eigen::Matrix3d& A, const Eigen::Vector3d& b, const ConeContact& contact,
                   Eigen::Vector3d* p);

}  // namespace constraint_sim::engine
