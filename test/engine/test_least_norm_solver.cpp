// Dense systems of any rank against Eigen's complete orthogonal decomposition.

#include "counted_allocations.h"
#include "dense_systems.h"
#include "engine/math/least_norm_solver.h"
#include "support.h"

namespace constraint_sim::engine {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

constexpr double kLeastPivot = 1e-10;
// Products of random factors have condition numbers of up to some thousands.
constexpr double kSolverRounding = 1e4 * kEpsilon;

MatrixXd random_matrix(Index rows, Index columns, Random* random) {
  return MatrixXd::NullaryExpr(rows, columns, [&] { return (*random)(); });
}

VectorXd least_norm_solution(const MatrixXd& A, VectorXd b, LeastNormSolver* solver,
                             bool is_regular = false) {
  double* const to = solver->resize(static_cast<std::size_t>(A.rows()));
  Eigen::Map<MatrixXd>(to, A.rows(), A.rows()) = A;
  if (is_regular)
    solver->factor_regular();
  else
    solver->factor(kLeastPivot);
  solver->solve(b.data());
  return b;
}

TEST(LeastNormSolver, FindsWhatACompleteOrthogonalDecompositionFinds) {
  Random random;
  LeastNormSolver solver;
  for (Index n = 1; n <= 14; ++n) {
    for (Index rank = 0; rank <= n; ++rank) {
      const MatrixXd A = random_matrix(n, rank, &random) * random_matrix(rank, n, &random);
      const VectorXd b = random_matrix(n, 1, &random);  // mostly inconsistent
      const VectorXd x = least_norm_solution(A, b, &solver);
      const VectorXd other = dense_least_norm_solution(A, b, kLeastPivot);
      EXPECT_EQ(solver.rank(), static_cast<std::size_t>(rank));
      EXPECT_LT((x - other).norm(), kSolverRounding * (1.0 + other.squaredNorm()))
          << n << ' ' << rank;
    }
  }
}

TEST(LeastNormSolver, SolvesWhatIsRegularWithEitherFactors) {
  Random random;
  LeastNormSolver solver;
  for (Index n = 1; n <= 14; ++n) {
    const MatrixXd A = random_matrix(n, n, &random);
    const VectorXd x = random_matrix(n, 1, &random);
    for (const bool is_regular : {false, true})
      EXPECT_LT((least_norm_solution(A, A * x, &solver, is_regular) - x).norm(),
                kSolverRounding * static_cast<double>(n))
          << n;
  }
}

// Whatever was solved before, the numbers are those of a solver that is new.
TEST(LeastNormSolver, KeepsFactorsWithoutATrace) {
  Random random;
  LeastNormSolver solver;
  const MatrixXd regular = random_matrix(6, 6, &random), other = random_matrix(6, 6, &random);
  const MatrixXd singular = random_matrix(6, 3, &random) * random_matrix(3, 6, &random);
  const MatrixXd large = random_matrix(7, 7, &random);
  const auto expect_as_new = [&](const MatrixXd& A, bool is_regular) {
    const VectorXd b = random_matrix(A.rows(), 1, &random);
    LeastNormSolver fresh;
    EXPECT_EQ(least_norm_solution(A, b, &solver, is_regular),
              least_norm_solution(A, b, &fresh, is_regular));
    EXPECT_EQ(solver.rank(), fresh.rank());
  };
  for (const MatrixXd* A : {&regular, &regular, &singular, &singular, &other, &regular, &large})
    for (const bool is_regular : {false, false, true, true, false})
      if (A != &singular || !is_regular) expect_as_new(*A, is_regular);
}

TEST(LeastNormSolver, AnswersNoNumbersWithNone) {
  LeastNormSolver solver;
  MatrixXd A = MatrixXd::Identity(3, 3);
  A(1, 2) = kNaN;
  for (const bool is_regular : {false, true})
    EXPECT_FALSE(least_norm_solution(A, VectorXd::Ones(3), &solver, is_regular).allFinite());
}

TEST(LeastNormSolver, AllocatesNothingOnceItHasHadItsLargest) {
  Random random;
  LeastNormSolver solver;
  std::vector<double> b(12, 1.0);
  const auto solve_all = [&] {
    for (const std::size_t n : {12, 3, 12, 6}) {
      double* const A = solver.resize(n);
      std::fill_n(A, n * n, 1.0);  // rank one
      solver.factor(kLeastPivot);
      solver.solve(b.data());
    }
  };
  solve_all();
  const std::size_t before = counted_allocations();
  solve_all();
  EXPECT_EQ(counted_allocations(), before);
}

}  // namespace
}  // namespace constraint_sim::engine
