// The interior-point method for cone problems: against the solutions from which problems were made,
// and what it saves the cone solver.

#include <gtest/gtest.h>

#include <Eigen/Core>
#include <cmath>

#include "draw.h"
#include "engine/math/cone_solver.h"
#include "engine/math/interior_point.h"

namespace constraint_sim::engine {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::Vector2d;
using Eigen::VectorXd;

/// Problem made from its solution.
struct Made {
  ConeProblem problem;
  VectorXd impulses, rates;
};

/// Draws impulses and rates of contacts that are open, stick or slip, and of rows within and at
/// their bounds, and a matrix of the given rank that has them as a solution. Each share of a force
/// or rate that is not zero is at least a tenth.
Made draw_problem(Draw* draw, std::size_t contacts, std::size_t rows, std::size_t rank) {
  const auto size = [&] { return 0.1 + draw->share(); };
  const auto direction = [&] { return Vector2d((*draw)(), (*draw)()).normalized(); };
  const auto n = static_cast<Index>(3 * contacts + rows);
  Made made{{}, VectorXd::Zero(n), VectorXd::Zero(n)};
  for (std::size_t c = 0; c < contacts; ++c) {
    const auto first = static_cast<Index>(3 * c);
    ConeContact of{draw->below(5) == 0 ? 0.0 : 0.1 + 0.4 * draw->share(), false, {}};
    const std::size_t state = draw->below(3);
    if (state == 0) {  // open
      made.rates[first] = size();
      made.rates.segment<2>(first + 1) = size() * direction();
    } else {
      made.impulses[first] = size();
      const Vector2d along = direction();
      const bool slips = state == 1 || of.friction == 0.0;
      const double share = slips ? 1.0 : 0.9 * draw->share();
      made.impulses.segment<2>(first + 1) = -share * of.friction * made.impulses[first] * along;
      if (slips) made.rates.segment<2>(first + 1) = size() * along;
    }
    made.problem.contacts.push_back(of);
  }
  for (std::size_t k = 0; k < rows; ++k) {
    const auto i = static_cast<Index>(3 * contacts + k);
    BoundedRow of{draw->below(3) == 0 ? -kInfinity : -size(), size()};
    made.impulses[i] = 0.5 * of.most;
    switch (draw->below(3)) {
      case 0:
        made.impulses[i] = of.most;
        made.rates[i] = -size();
        break;
      case 1:
        if (!std::isfinite(of.least)) break;
        made.impulses[i] = of.least;
        made.rates[i] = size();
        break;
      default:
        break;
    }
    made.problem.rows.push_back(of);
  }
  const auto r = static_cast<Index>(rank);
  MatrixXd root(n, r);
  for (Index i = 0; i < n; ++i)
    for (Index j = 0; j < r; ++j) root(i, j) = (*draw)();
  const MatrixXd A = root * root.transpose() / static_cast<double>(rank);
  const VectorXd b = made.rates - A * made.impulses;
  made.problem.A.assign(A.data(), A.data() + A.size());
  made.problem.b.assign(b.data(), b.data() + b.size());
  return made;
}

VectorXd rates_of(const ConeProblem& problem, const List<double>& p) {
  const auto n = static_cast<Index>(p.size());
  const Eigen::Map<const VectorXd> b(problem.b.data(), n), impulses(p.data(), n);
  return b + Eigen::Map<const MatrixXd>(problem.A.data(), n, n) * impulses;
}

/// Largest violation of the conditions of a ConeProblem: products and excesses.
double violation(const ConeProblem& problem, const List<double>& p) {
  const VectorXd u = rates_of(problem, p);
  double worst = 0.0;
  for (std::size_t c = 0; c < problem.contacts.size(); ++c) {
    const auto i = static_cast<Index>(3 * c);
    const double mu = problem.contacts[c].friction, normal = p[3 * c];
    const Vector2d along(p[3 * c + 1], p[3 * c + 2]), slip = u.segment<2>(i + 1);
    worst = std::max({worst, -normal, -u[i], normal * u[i], along.norm() - mu * normal,
                      (along * slip.norm() + mu * normal * slip).norm()});
  }
  for (std::size_t k = 0; k < problem.rows.size(); ++k) {
    const std::size_t i = 3 * problem.contacts.size() + k;
    const double rate = u[static_cast<Index>(i)];
    const BoundedRow& of = problem.rows[k];
    worst = std::max({worst, of.least - p[i], p[i] - of.most,
                      rate > 0.0 ? rate * (p[i] - of.least) : -rate * (of.most - p[i])});
  }
  return worst;
}

// With a regular A and little friction the solution is unique.
TEST(InteriorPoint, FindsTheSolutionFromWhichAProblemIsMade) {
  Draw draw(11);
  for (int k = 0; k < 300; ++k) {
    const std::size_t contacts = 1 + draw.below(6), rows = draw.below(4);
    const Made made = draw_problem(&draw, contacts, rows, 2 * (3 * contacts + rows));
    InteriorPoint method;
    SolveEffort effort;
    method.begin(made.problem, 1.0, 0.0);
    ASSERT_TRUE(method.approach(1e-13, &effort)) << k;
    List<double> p(made.problem.b.size());
    method.write(p.data());
    const Eigen::Map<const VectorXd> found(p.data(), made.impulses.size());
    // Products of 1e-13 leave rates and impulses of 1e-12, less than 1e-9 by the smallest response.
    EXPECT_LT((found - made.impulses).lpNorm<Eigen::Infinity>(), 1e-9) << k;
    EXPECT_LT(violation(made.problem, p), 1e-11) << k;
  }
}

// Redundant contacts have many solutions; all conditions hold to the products that are asked for.
TEST(InteriorPoint, MeetsTheConditionsOfRedundantContacts) {
  Draw draw(12);
  for (int k = 0; k < 300; ++k) {
    const std::size_t contacts = 4 + draw.below(8);
    const Made made = draw_problem(&draw, contacts, 0, contacts + 2);
    InteriorPoint method;
    SolveEffort effort;
    method.begin(made.problem, 1.0, 0.0);
    ASSERT_TRUE(method.approach(1e-12, &effort)) << k;
    List<double> p(made.problem.b.size());
    method.write(p.data());
    EXPECT_LT(violation(made.problem, p), 1e-10) << k;
  }
}

TEST(InteriorPoint, EndsWithoutASolution) {
  ConeProblem problem;  // nothing moves the contact, which approaches
  problem.A.assign(9, 0.0);
  problem.b = {-1.0, 0.0, 0.0};
  problem.contacts.push_back({0.5, false, {}});
  InteriorPoint method;
  SolveEffort effort;
  method.begin(problem, 1.0, 0.0);
  EXPECT_FALSE(method.approach(1e-9, &effort));
  EXPECT_LT(effort.spent, 41.0 * cost_of_newton_step(3));
}

// Where Newton's method alone finds no solution of redundant contacts, the solver goes on from this
// method, and needs less for the same contacts a second time, with other rates.
TEST(InteriorPoint, SolutionsOfTheConeSolverAreUsedAgain) {
  Draw draw(13);
  int hard = 0;
  double first = 0.0, second = 0.0;
  for (int k = 0; k < 100; ++k) {
    Made made = draw_problem(&draw, 10, 0, 12);
    const double newton = 12.0 * cost_of_newton_step(30);  // more than Newton's method alone takes
    ConeSolver solver;
    List<double> p;
    SolveEffort effort;
    ASSERT_TRUE(solver.solve(made.problem, &p, &effort)) << k;
    EXPECT_LT(violation(made.problem, p), 1e-9) << k;
    if (effort.spent < newton) continue;
    ++hard;
    first += effort.spent;
    for (double& rate : made.problem.b) rate *= 0.7;
    effort.spent = 0.0;
    ASSERT_TRUE(solver.solve(made.problem, &p, &effort)) << k;
    EXPECT_LT(violation(made.problem, p), 1e-9) << k;
    second += effort.spent;
    SolveEffort anew;
    solver.forget();
    ASSERT_TRUE(solver.solve(made.problem, &p, &anew)) << k;
    EXPECT_GE(anew.spent, newton) << k;
  }
  EXPECT_GT(hard, 10);
  EXPECT_LT(second, 0.5 * first);
}

}  // namespace
}  // namespace constraint_sim::engine
