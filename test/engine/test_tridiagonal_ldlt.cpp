// Elimination from both ends against dense solutions.

#include <gtest/gtest.h>

#include <Eigen/Dense>

#include "engine/math/tridiagonal_ldlt.h"

namespace constraint_sim::engine {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

constexpr double kLeast = 1e-8;  // least pivot over its diagonal entry

/// Returns a tridiagonal, positive definite matrix: B Bᵀ of a random bidiagonal B.
MatrixXd random_matrix(Index n) {
  MatrixXd B = MatrixXd::Zero(n, n);
  for (Index i = 0; i < n; ++i) {
    B(i, i) = 1.5 + Eigen::internal::random<double>(-0.5, 0.5);
    if (i > 0) B(i, i - 1) = Eigen::internal::random<double>(-1.0, 1.0);
  }
  return B * B.transpose();
}

void set(TridiagonalLdlt* ldlt, const MatrixXd& A) {
  for (Index i = 0; i < A.rows(); ++i) {
    ldlt->diagonal()[i] = A(i, i);
    if (i + 1 < A.rows()) ldlt->off_diagonal()[i] = A(i, i + 1);
  }
}

TEST(TridiagonalLdlt, SolvesAsADenseMatrixDoes) {
  for (const Index n : {1, 2, 3, 4, 5, 10, 11, 100}) {
    const MatrixXd A = random_matrix(n);
    TridiagonalLdlt ldlt;
    ldlt.resize(static_cast<std::size_t>(n));
    set(&ldlt, A);
    const VectorXd b = VectorXd::Random(n);
    const VectorXd c = VectorXd::Random(n);
    VectorXd x = b;
    ASSERT_TRUE(ldlt.factor_and_solve(kLeast, x.data())) << n;
    EXPECT_LE((A * x - b).norm(), 1e-13 * static_cast<double>(n)) << n;
    x = c;
    ldlt.solve(x.data());
    EXPECT_LE((A * x - c).norm(), 1e-13 * static_cast<double>(n)) << n;
  }
}

TEST(TridiagonalLdlt, TellsWhereARowDependsOnOthers) {
  for (const Index n : {1, 2, 3, 6, 7}) {
    for (Index zero = 0; zero < n; ++zero) {
      MatrixXd B = MatrixXd::Identity(n, n);
      if (n > 1) B.row(zero) = B.row(zero == 0 ? 1 : zero - 1);  // a duplicated row
      if (n == 1) B.setZero();
      TridiagonalLdlt ldlt;
      ldlt.resize(static_cast<std::size_t>(n));
      set(&ldlt, B * B.transpose());
      VectorXd x = VectorXd::Ones(n);
      EXPECT_FALSE(ldlt.factor_and_solve(kLeast, x.data())) << n << " " << zero;
    }
  }
}

}  // namespace
}  // namespace constraint_sim::engine
