#pragma once

#include <Eigen/Core>

#include "engine/math/list.h"

namespace constraint_sim::engine {

/// A linear complementarity problem with bounds. With a = b + A x and x between `least` and `most`,
/// each i has a = 0, or x = least and a ≥ 0, or x = most and a ≤ 0.
struct BoxLcp {
  Eigen::MatrixXd A;  ///< symmetric, positive semidefinite
  Eigen::VectorXd b, least, most;
};

/// Solves the problem as the minimum of ½ xᵀA x + bᵀx within the bounds, by an active-set method:
/// Lawson & Hanson, Solving Least Squares Problems (1974), chapter 23, with bounds on both sides
/// (Stark & Parker, Computational Statistics 10 (1995) 129). A may be singular: one of several
/// solutions is returned. Returns false where no solution exists.
bool solve(const BoxLcp& problem, Eigen::VectorXd* x);

/// Pivot of a matrix scaled to a diagonal of one, below which a row depends on others.
inline constexpr double kDependent = 1e-9;

/// Returns the pivot of a row after `rows`, which are linearly independent.
double pivot_beside(const Eigen::MatrixXd& A, const List<Eigen::Index>& rows, Eigen::Index row);

/// Returns the rate of `row` for a unit impulse along it while independent rows among `others`
/// hold; where they leave no freedom, the rate without them.
double response_beside(const Eigen::MatrixXd& A, const List<Eigen::Index>& others,
                       Eigen::Index row);

}  // namespace constraint_sim::engine
