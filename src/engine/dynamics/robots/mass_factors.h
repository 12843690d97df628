#pragma once

#include <Eigen/Core>

namespace constraint_sim::engine {

/// Factors M = Lᵀ D L of a positive definite mass matrix, from the last coordinate to the first, as
/// from the leaves of a tree to its root. Sums are in a fixed order.
class MassFactors {
 public:
  explicit MassFactors(Eigen::MatrixXd M);

  /// Returns x with M x = b.
  Eigen::VectorXd solve(Eigen::VectorXd b) const;
  /// Returns X with M X = B.
  Eigen::MatrixXd solve_all(Eigen::MatrixXd B) const;
  /// Least quotient of a pivot (an entry of D) and the diagonal entry of M of the same coordinate.
  double least_pivot() const { return least_pivot_; }
  /// Coordinate of least_pivot().
  Eigen::Index least_coordinate() const { return least_coordinate_; }

 private:
  Eigen::MatrixXd factors_;  // L below the diagonal, D on it
  double least_pivot_ = 1.0;
  Eigen::Index least_coordinate_ = 0;
};

}  // namespace constraint_sim::engine
