// Roots of polynomials in Bernstein's basis, and complementarity problems with bounds.

#include "engine/math/box_lcp.h"
#include "engine/math/first_root.h"
#include "support.h"

namespace constraint_sim::engine {
namespace {

/// Returns Bernstein coefficients of a product of (θ − r), by Farouki's product of degree-one
/// factors.
template <std::size_t n>
Bernstein<n> product(double factor, const std::array<double, n - 1>& roots) {
  std::vector<double> p{factor};
  for (const double r : roots) {  // times −r (1 − θ) + (1 − r) θ
    const std::size_t degree = p.size();
    std::vector<double> next(degree + 1, 0.0);
    for (std::size_t i = 0; i < degree; ++i) {
      const double share = static_cast<double>(i + 1) / static_cast<double>(degree);
      next[i] += p[i] * -r * (1.0 - static_cast<double>(i) / static_cast<double>(degree));
      next[i + 1] += p[i] * (1.0 - r) * share;
    }
    p = next;
  }
  Bernstein<n> result;
  std::copy(p.begin(), p.end(), result.begin());
  return result;
}

TEST(FirstRoot, IsWhereAPolynomialFallsBelowZero) {
  // five roots; positive at first
  EXPECT_NEAR(*first_root(product<6>(1.0, {0.3, 0.31, 0.7, 1.5, -2.0})), 0.3, 1e-12);
  EXPECT_EQ(*first_root(product<6>(-1.0, {0.3, 0.31, 0.7, 1.5, -2.0})), 0.0);
  EXPECT_NEAR(*first_root(product<4>(-1.0, {0.25, 0.5, 0.9})), 0.25, 1e-12);
  EXPECT_FALSE(first_root(product<4>(-1.0, {1.25, 1.5, 1.9})));
  // touches zero without crossing
  EXPECT_FALSE(first_root(Bernstein<3>{0.25, -0.24, 0.25}));
  // two roots within a hundredth of the interval
  EXPECT_NEAR(*first_root(product<3>(1.0, {0.5, 0.501})), 0.5, 1e-12);
}

TEST(FirstRoot, AfterZero) {
  EXPECT_NEAR(*first_root_after_zero(product<6>(-1.0, {0.0, 0.4, 1.2, 1.3, -1.0})), 0.4, 1e-12);
  EXPECT_FALSE(first_root_after_zero(product<3>(1.0, {0.0, -0.5})));
}

/// Returns the largest violation of the conditions.
double violation(const BoxLcp& problem, const Eigen::VectorXd& x) {
  const Eigen::VectorXd a = problem.b + problem.A * x;
  double worst = 0.0;
  for (Eigen::Index i = 0; i < x.size(); ++i) {
    worst = std::max({worst, problem.least[i] - x[i], x[i] - problem.most[i]});
    if (x[i] < problem.most[i]) worst = std::max(worst, -a[i]);
    if (x[i] > problem.least[i]) worst = std::max(worst, a[i]);
  }
  return worst;
}

TEST(BoxLcp, MeetsItsConditions) {
  Random random;
  for (int k = 0; k < 500; ++k) {
    const Eigen::Index n = 1 + k % 9, rank = 1 + k % n;
    Eigen::MatrixXd J(n, rank);
    for (Eigen::Index i = 0; i < J.size(); ++i) J.data()[i] = random();
    BoxLcp problem{J * J.transpose(), Eigen::VectorXd(n), Eigen::VectorXd(n), Eigen::VectorXd(n)};
    for (Eigen::Index i = 0; i < n; ++i) {
      problem.b[i] = random();
      const bool is_one_sided = rank == n && random() > 0.0;
      problem.least[i] = is_one_sided ? 0.0 : -std::abs(random());
      problem.most[i] = is_one_sided ? kInfinity : std::abs(random());
    }
    Eigen::VectorXd x;
    ASSERT_TRUE(solve(problem, &x)) << k;
    // rounding of forces that a badly conditioned A makes large
    EXPECT_LT(violation(problem, x), 1e-9 * (1.0 + x.lpNorm<Eigen::Infinity>())) << k;
  }
}

TEST(BoxLcp, SaysWhereThereIsNoAnswer) {
  // two equal rows with different target rates and unbounded force
  const BoxLcp problem{Eigen::MatrixXd::Ones(2, 2), Eigen::Vector2d(-1.0, 1.0),
                       Eigen::Vector2d::Constant(-kInfinity), Eigen::Vector2d::Constant(kInfinity)};
  Eigen::VectorXd x;
  EXPECT_FALSE(solve(problem, &x));
}

}  // namespace
}  // namespace constraint_sim::engine
