#pragma once

#include <Eigen/Core>

/// Linear algebra of matrices with sizes known at run time, each sum in a fixed order. Eigen's own
/// products and factorizations of such matrices add in an order that depends on its version, on the
/// registers of the processor and on the size of its caches.
namespace constraint_sim::engine::math {

/// Returns Σ aᵢ bᵢ, summed from the first element on.
double dot(const Eigen::VectorXd& a, const Eigen::VectorXd& b);

/// Returns A x, summed column after column.
Eigen::VectorXd product(const Eigen::MatrixXd& A, const Eigen::VectorXd& x);

/// Returns x with A x = b for a symmetric positive semidefinite A, by LDLᵀ with the largest
/// diagonal entry as pivot (Golub and Van Loan, "Matrix Computations", section 4.2.8). Skips pivots
/// of zero.
Eigen::VectorXd solve_semidefinite(Eigen::MatrixXd A, Eigen::VectorXd b);

/// Eigenvalues of a symmetric matrix, unsorted, and unit eigenvectors as columns.
struct Eigensystem {
  Eigen::Vector3d values;
  Eigen::Matrix3d vectors;
};

/// Returns eigenvalues and eigenvectors of a symmetric A, by Jacobi's rotations (Golub and Van
/// Loan, section 8.5).
Eigensystem eigensystem(Eigen::Matrix3d A);

}  // namespace constraint_sim::engine::math
