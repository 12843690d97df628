#include "dense_systems.h"

#include <Eigen/LU>
#include <Eigen/QR>

namespace constraint_sim::engine {

using Eigen::MatrixXd;
using Eigen::VectorXd;

VectorXd dense_solution(const MatrixXd& A, const VectorXd& b) {
  return Eigen::PartialPivLU<MatrixXd>(A).solve(b);
}

MatrixXd dense_inverse(const MatrixXd& A) { return Eigen::PartialPivLU<MatrixXd>(A).inverse(); }

Eigen::Index dense_rank(const MatrixXd& A, double threshold) {
  Eigen::ColPivHouseholderQR<MatrixXd> factors(A);
  factors.setThreshold(threshold);
  return factors.rank();
}

VectorXd dense_least_norm_solution(const MatrixXd& A, const VectorXd& b, double threshold) {
  Eigen::CompleteOrthogonalDecomposition<MatrixXd> factors;
  factors.setThreshold(threshold);
  factors.compute(A);
  return factors.solve(b);
}

}  // namespace constraint_sim::engine
