#pragma once

#include <Eigen/Core>

namespace constraint_sim::engine {

// Eigen's factorizations of matrices with sizes known at run time, the oracles of the engine's own.
// Their templates take seconds to compile, and do so once for all tests.

/// Returns x with A x = b for a regular A, by LU factors with partial pivoting.
Eigen::VectorXd dense_solution(const Eigen::MatrixXd& A, const Eigen::VectorXd& b);

/// Returns A⁻¹, by LU factors with partial pivoting.
Eigen::MatrixXd dense_inverse(const Eigen::MatrixXd& A);

/// Returns the rank by QR factors with column pivoting. Pivots below `threshold` of the largest are
/// zero.
Eigen::Index dense_rank(const Eigen::MatrixXd& A, double threshold);

/// Returns the shortest x of least ‖A x − b‖, by a complete orthogonal decomposition. Pivots below
/// `threshold` of the largest are zero.
Eigen::VectorXd dense_least_norm_solution(const Eigen::MatrixXd& A, const Eigen::VectorXd& b,
                                          double threshold);

}  // namespace constraint_sim::engine
