// The sparse factorisation against dense ones, and its behaviour with dependent rows.

#include "dense_systems.h"
#include "engine/math/list.h"
#include "engine/math/sparse_ldlt.h"
#include "support.h"

namespace constraint_sim::engine {
namespace {

using Eigen::MatrixXd;
using Eigen::VectorXd;
using Pattern = List<std::pair<int, int>>;

/// Returns a factorisation of A with this pattern.
SparseLdlt with_values(const MatrixXd& A, const Pattern& pattern) {
  SparseLdlt ldlt;
  ldlt.analyze(static_cast<int>(A.rows()), pattern);
  for (int i = 0; i < A.rows(); ++i) ldlt.values()[ldlt.slot(i, i)] = A(i, i);
  for (const auto& [i, j] : pattern) ldlt.values()[ldlt.slot(i, j)] = A(i, j);
  return ldlt;
}

VectorXd solution(const SparseLdlt& ldlt, const VectorXd& b) {
  VectorXd permuted(b.size()), x(b.size());
  for (int i = 0; i < b.size(); ++i) permuted[ldlt.place(i)] = b[i];
  ldlt.solve(permuted.data());
  for (int i = 0; i < b.size(); ++i) x[i] = permuted[ldlt.place(i)];
  return x;
}

/// Returns a well-conditioned G Gᵀ with this pattern.
MatrixXd positive_definite(int n, const Pattern& pattern, Random* random) {
  MatrixXd A = MatrixXd::Zero(n, n);
  for (const auto& [i, j] : pattern) A(i, j) = A(j, i) = (*random)();
  for (int i = 0; i < n; ++i) A(i, i) = 1.0 + A.row(i).cwiseAbs().sum();
  return A;
}

void expect_solves(int n, const Pattern& pattern, Random* random) {
  const MatrixXd A = positive_definite(n, pattern, random);
  SparseLdlt ldlt = with_values(A, pattern);
  EXPECT_EQ(ldlt.factor(1e-8), 0);
  const VectorXd b = VectorXd::LinSpaced(n, -1.0, 1.0);
  const VectorXd x = solution(ldlt, b);
  // diagonally dominant, so both solutions are accurate to n roundings
  EXPECT_LE((x - dense_solution(A, b)).norm(), 4.0 * n * kEpsilon * x.norm());
}

TEST(SparseLdlt, SolvesChainsTreesAndForests) {
  Random random;
  for (const int n : {1, 2, 3, 10, 101}) {
    Pattern chain, tree, forest;
    for (int i = 1; i < n; ++i) {
      chain.emplace_back(i, i - 1);
      tree.emplace_back((i - 1) / 3, i);
      if (i % 4 != 0) forest.emplace_back(i - 1, i);
    }
    for (const Pattern& pattern : {chain, tree, forest}) expect_solves(n, pattern, &random);
  }
}

TEST(SparseLdlt, SolvesRandomPatternsWithLoops) {
  Random random;
  for (int trial = 0; trial < 50; ++trial) {
    const int n = 2 + static_cast<int>(10.0 * (1.0 + random()));
    Pattern pattern;
    for (int i = 1; i < n; ++i)
      for (int j = 0; j < i; ++j)
        if (random() > 0.4) pattern.emplace_back(i, j);
    expect_solves(n, pattern, &random);
  }
}

// All rows are coupled, as those of one body: they are one block, in their own order.
TEST(SparseLdlt, SolvesCompletePatterns) {
  Random random;
  for (int n = 2; n <= 20; ++n) {
    Pattern pattern;
    for (int i = 0; i < n; ++i)
      for (int j = 0; j < i; ++j) pattern.emplace_back(i % 2 == 0 ? i : j, i % 2 == 0 ? j : i);
    pattern.push_back(pattern.front());
    pattern.emplace_back(0, 0);
    expect_solves(n, pattern, &random);
    SparseLdlt ldlt;
    ldlt.analyze(n, pattern);
    for (int i = 0; i < n; ++i) EXPECT_EQ(ldlt.place(i), i);
    EXPECT_EQ(ldlt.values().size(), static_cast<std::size_t>(n * n));
  }
}

TEST(SparseLdlt, SolvesNets) {  // nets have blocks of all widths
  Random random;
  for (const int side : {3, 10, 20}) {
    Pattern pattern;
    for (int i = 0; i < side * side; ++i) {
      if (i % side != 0) pattern.emplace_back(i, i - 1);
      if (i >= side) pattern.emplace_back(i, i - side);
    }
    expect_solves(side * side, pattern, &random);
  }
}

TEST(SparseLdlt, ChainsAndTreesHaveNoFill) {
  Pattern tree;
  for (int i = 1; i < 1000; ++i) tree.emplace_back((i - 1) / 2, i);
  SparseLdlt ldlt;
  ldlt.analyze(1000, tree);
  EXPECT_EQ(ldlt.values().size(), 1000u + 1000u);  // the root has an entry below it too
}

TEST(SparseLdlt, RingsHaveLittleFill) {
  Pattern ring;
  for (int i = 0; i < 100; ++i) ring.emplace_back(i, (i + 1) % 100);
  SparseLdlt ldlt;
  ldlt.analyze(100, ring);
  // fill is n - 3 entries in any order; a fifth of zeros may be kept, and corners of blocks of two
  EXPECT_GE(ldlt.values().size(), 100u + 100u + 97u);
  EXPECT_LE(ldlt.values().size(), 1.5 * (100.0 + 100.0 + 97.0));
}

TEST(SparseLdlt, RepeatedAndTransposedEntriesAreOne) {
  SparseLdlt ldlt;
  ldlt.analyze(3, {{0, 1}, {1, 0}, {0, 1}, {2, 2}});
  EXPECT_EQ(ldlt.slot(0, 1), ldlt.slot(1, 0));
  for (const int i : {0, 1, 2}) ldlt.values()[ldlt.slot(i, i)] = 2.0;
  ldlt.values()[ldlt.slot(0, 1)] = 1.0;
  EXPECT_EQ(ldlt.factor(1e-8), 0);
  const VectorXd x = solution(ldlt, Eigen::Vector3d(3.0, 0.0, 4.0));
  EXPECT_LE((x - Eigen::Vector3d(2.0, -1.0, 2.0)).norm(), 4.0 * kEpsilon);
}

TEST(SparseLdlt, CountsAndTouchesDependentRows) {
  // two pairs of equal rows among six, in a chain and with a loop
  for (const bool has_loop : {false, true}) {
    MatrixXd G = MatrixXd::Random(6, 9);
    Pattern pattern;
    MatrixXd A;
    if (has_loop) {
      G.row(3) = G.row(0);
      G.row(5) = -2.0 * G.row(1);
      A = G * G.transpose();
      for (int i = 0; i < 6; ++i)
        for (int j = 0; j < i; ++j) pattern.emplace_back(i, j);
    } else {
      A = MatrixXd::Zero(6, 6);
      for (int i = 0; i < 6; i += 2) {
        A.block<2, 2>(i, i) << 4.0, 2.0, 2.0, i < 4 ? 1.0 : 3.0;
        pattern.emplace_back(i, i + 1);
      }
    }
    SparseLdlt ldlt = with_values(A, pattern);
    EXPECT_EQ(ldlt.factor(1e-8), 2) << has_loop;
    // pivots of dependent rows are rounding errors
    EXPECT_LT(ldlt.smallest_pivot(), 1e-14);
    const VectorXd x = solution(ldlt, A * VectorXd::Ones(6));
    EXPECT_LE((A * x - A * VectorXd::Ones(6)).norm(), 1e-13 * A.norm());  // rounding
  }
}

TEST(SparseLdlt, LeavesDependentRowsOut) {
  for (const bool has_loop : {false, true}) {
    MatrixXd G = MatrixXd::Random(5, 6);
    if (!has_loop) G.bottomRows(3).setZero();
    if (has_loop) G.row(4) = G.row(1) + 2.0 * G.row(2);
    if (!has_loop) G.row(1) = -G.row(0);
    const MatrixXd A = G * G.transpose();
    Pattern pattern;
    for (int i = 0; i < 5; ++i)
      for (int j = 0; j < i; ++j)
        if (has_loop || i == 1) pattern.emplace_back(i, j);
    SparseLdlt ldlt = with_values(A, pattern);
    const int left_out = ldlt.factor(1e-8);
    List<int> kept;
    for (int i = 0; i < 5; ++i)
      if (!ldlt.is_left_out(static_cast<std::size_t>(ldlt.place(i)))) kept.push_back(i);
    EXPECT_EQ(left_out, 1) << has_loop;
    EXPECT_EQ(kept.size(), 4u) << has_loop;
    if (!has_loop) continue;  // rows without a force are kept
    // the kept rows are independent
    MatrixXd rest(4, 6);
    for (int i = 0; i < 4; ++i) rest.row(i) = G.row(kept[static_cast<std::size_t>(i)]);
    EXPECT_EQ(dense_rank(rest, 1e-10), 4);
  }
}

TEST(SparseLdlt, AnEmptyRowGetsNoForce) {
  for (const Pattern& pattern :
       {Pattern{}, Pattern{{0, 0}}, Pattern{{1, 2}, {2, 3}, {3, 1}}}) {  // the last with a loop
    const int n = pattern.size() < 2 ? 1 : 4;
    MatrixXd A = MatrixXd::Zero(n, n);
    if (n == 4) A.bottomRightCorner(3, 3) << 2.0, 1.0, 0.0, 1.0, 2.0, 1.0, 0.0, 1.0, 2.0;
    SparseLdlt ldlt = with_values(A, pattern);
    ldlt.factor(1e-8);
    const VectorXd x = solution(ldlt, VectorXd::Ones(n));
    EXPECT_EQ(x[0], 0.0);
    EXPECT_LE((A * x - VectorXd::Ones(n)).tail(n - 1).norm(), 8.0 * kEpsilon);
  }
}

}  // namespace
}  // namespace constraint_sim::engine
