#pragma once

#include <Eigen/Core>

/// Linear algebra of matrices whose size is known at run time, each sum in one order. Eigen's own
/// products and factorisations of such matrices add up in an order that depends on its version, on
/// the processor's registers and on the size of its caches.
namespace constraint_sim::engine::math {

/// Σ aᵢ bᵢ, from the first element on.
double dot(const Eigen::VectorXd& a, const Eigen::VectorXd& b);

/// A x, column after column.
Eigen::VectorXd product(const Eigen::MatrixXd& A, const Eigen::VectorXd& x);

/// x with A x = b for a symmetric, positive semidefinite A, by LDLᵀ with the largest diagonal entry
/// as pivot (Golub and Van Loan, "Matrix Computations", section 4.2.8). Pivots of zero are left
/// out.
Eigen::VectorXd solve_semidefinite(Eigen::MatrixXd A, Eigen::VectorXd b);

/// Eigenvalues of a symmetric matrix, in no order, and unit eigenvectors as columns.
struct Eigensystem {
  Eigen::Vector3d values;
  Eigen::Matrix3d vectors;
};

/// Eigenvalues and eigenvectors of a symmetric A, by Jacobi's rotations (ibid., section 8.5).
Eigensystem eigensystem(Eigen::Matrix3d A);

}  // namespace constraint_sim::engine::math
