#pragma once

#include <Eigen/Core>

#include "engine/math/list.h"

namespace constraint_sim::engine {

/// A linear complementarity problem with bounds: x between `least` and `most` with a = b + A x, and
/// for each i a = 0, or x = least and a ≥ 0, or x = most and a ≤ 0.
struct BoxLcp {
  Eigen::MatrixXd A;  ///< symmetric, positive semidefinite
  Eigen::VectorXd b, least, most;
};

/// Solves it as the minimum of ½ xᵀA x + bᵀx within the bounds, by active sets: Lawson & Hanson,
/// Solving Least Squares Problems (1974), chapter 23, with bounds on both sides (Stark & Parker,
/// Computational Statistics 10 (1995) 129). A may be singular: of several x one is returned. False
/// where there is none.
bool solve(const BoxLcp& problem, Eigen::VectorXd* x);

/// Rows with a pivot below, of a matrix scaled to a diagonal of one, follow from others.
inline constexpr double kDependent = 1e-9;

/// The pivot of a row after others, which are independent.
double pivot_beside(const Eigen::MatrixXd& A, const List<Eigen::Index>& rows, Eigen::Index row);

/// What a unit along a row does to it while others hold, those of them that do not follow from each
/// other; and as without these where they leave nothing of it.
double response_beside(const Eigen::MatrixXd& A, const List<Eigen::Index>& others,
                       Eigen::Index row);

}  // namespace constraint_sim::engine
