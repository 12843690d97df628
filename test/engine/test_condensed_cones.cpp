// Newton's method without the rows without bounds, on trees of bodies with contacts: against the
// equations of all rows, and derivatives against finite differences.

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <cmath>
#include <cstdio>

#include "draw.h"
#include "engine/math/body_cone_blocks.h"
#include "engine/math/body_cone_solver.h"
#include "engine/math/body_equations.h"
#include "engine/math/condensed_cones.h"
#include "engine/math/list.h"
#include "engine/math/numbers.h"
#include "engine/math/proximal_newton.h"
#include "engine/math/row_elimination.h"

namespace constraint_sim::engine {
namespace {

using Kind = BodyConeProblem::Kind;
using Twist = BodyConeProblem::Twist;

/// A chain of bodies with five rows without bounds per joint, a row with bounds along the sixth
/// direction, and contacts of some bodies with the floor.
struct Walker {
  BodyConeProblem problem;
  Draw draw;

  Walker(unsigned seed, int bodies, double most_mass_ratio) : draw(seed) {
    for (int i = 0; i < bodies; ++i) {
      BodyConeProblem::Body body;
      body.mass = std::pow(most_mass_ratio, draw.between(0.0, 1.0));
      body.inverse_mass = 1.0 / body.mass;
      body.inertia = 0.01 * body.mass * Eigen::Vector3d(1.0, 1.5, 2.0).asDiagonal();
      body.inverse_inertia = body.inertia.inverse();
      problem.bodies.push_back(body);
    }
    for (int i = 1; i < bodies; ++i) {
      for (int k = 0; k < 5; ++k) add_row(i - 1, i, Kind::kSingle);
      BodyConeProblem::Row& motor = add_row(i - 1, i, Kind::kSingle);
      motor.most = draw.between(0.1, 2.0);
      motor.least = -motor.most;
    }
    for (int i = 0; i < bodies; i += 2) {
      const Eigen::Vector3d arm = 0.2 * draw.vector();
      for (int k = 0; k < 3; ++k) {
        BodyConeProblem::Row& row = add_row(-1, i, k == 0 ? Kind::kNormal : Kind::kTangent);
        problem.parts.back().J << Eigen::Vector3d::Unit((k + 2) % 3),
            arm.cross(Eigen::Vector3d::Unit((k + 2) % 3));
        if (k == 0) row.rate = -draw.between(0.0, 1.0);
        if (k == 0) row.friction = draw.between(0.0, 1.2);
      }
    }
  }
  BodyConeProblem::Row& add_row(int a, int b, Kind kind) {
    BodyConeProblem::Row row;
    row.kind = kind;
    row.rate = 0.5 * draw();
    for (const int body : {a, b})
      if (body >= 0) {
        BodyConeProblem::Part part{body, {}};
        part.J << draw.vector(), 0.2 * draw.vector();
        problem.parts.push_back(part);
      }
    row.parts_end = problem.parts.size();
    problem.rows.push_back(row);
    return problem.rows.back();
  }
  List<double> impulses() {
    List<double> p(problem.rows.size());
    for (double& value : p) value = draw();
    return p;
  }
};

struct Blocks {
  BodyConeBlocks blocks;
  List<Twist> v;

  explicit Blocks(const BodyConeProblem& problem) {
    blocks.set(problem);
    blocks.find_edges();
  }
  double residual(const List<double>& p) { return blocks.residual(p, &v); }
};

/// Improves p by Newton's method; returns the residual.
double solve(ProximalEquations* equations, Blocks* of, List<double>* p) {
  return ProximalNewton().solve({1e-10, 400, 1.0}, of->residual(*p), nullptr, equations, p);
}

/// Equations of a walker, begun at random impulses.
struct Begun {
  Walker walker;
  Blocks of{walker.problem};
  CondensedCones equations;

  Begun(unsigned seed, bool is_held) : walker(seed, 7, 100.0) {
    EXPECT_TRUE(equations.set(of.blocks));
    equations.hold_shifts(is_held);
    equations.begin(walker.impulses());
  }
};

// The gradient along the change, against a central difference of the potential. Second derivatives
// jump where a contact opens or begins to slip, which a difference of 1e-6 of the change seldom
// meets, and then by a share of 1e-6.
TEST(CondensedCones, ThePotentialHasTheGradient) {
  int compared = 0;
  for (unsigned seed = 1; seed <= 40; ++seed) {
    Begun begun(seed, true);
    CondensedCones& equations = begun.equations;
    for (const double sigma : {0.1, 1.0, 10.0}) {
      equations.evaluate(sigma, 0.0);
      ASSERT_TRUE(equations.find_change(sigma));
      const double slope = equations.slope(), step = 1e-6;
      EXPECT_LT(slope, 0.0);
      const double after = equations.evaluate(sigma, step).potential;
      const double before = equations.evaluate(sigma, -step).potential;
      EXPECT_NEAR((after - before) / (2.0 * step), slope, 1e-4 * std::abs(slope)) << seed;
      ++compared;
    }
  }
  EXPECT_EQ(compared, 120);
}

// A small share of a step of Newton's method takes that share of the gradient away, whether shifts
// are held or follow the slip. Derivatives jump in few contacts.
TEST(CondensedCones, NewtonsMethodTakesTheGradientAway) {
  int off = 0, compared = 0;
  for (unsigned seed = 1; seed <= 40; ++seed)
    for (const bool is_held : {false, true}) {
      Begun begun(seed, is_held);
      CondensedCones& equations = begun.equations;
      for (const double sigma : {0.1, 1.0, 10.0}) {
        const double square = equations.evaluate(sigma, 0.0).square, share = 1e-5;
        ASSERT_TRUE(equations.find_change(sigma));
        const double rest = equations.evaluate(sigma, share).square;
        off += std::abs((square - rest) / (2.0 * share * square) - 1.0) > 1e-3;
        ++compared;
      }
    }
  std::printf("%d of %d steps meet a jump\n", off, compared);
  EXPECT_LE(off, compared / 20);
}

// Impulses of the condensed equations solve the whole problem: rows with bounds have the residual
// of all rows, up to the rounding of the elimination.
TEST(CondensedCones, SolvesAllRows) {
  int unsolved = 0, compared = 0;
  for (const double masses : {1.0, 1e3, 1e6})
    for (unsigned seed = 1; seed <= 60; ++seed) {
      Walker walker(seed, 3 + static_cast<int>(seed) % 8, masses);
      Blocks of(walker.problem);
      CondensedCones equations;
      ASSERT_TRUE(equations.set(of.blocks));
      List<double> p(walker.problem.rows.size(), 0.0);
      const double residual = solve(&equations, &of, &p);
      unsolved += residual > 1e-10;
      ++compared;
      EXPECT_NEAR(of.residual(p), residual, 1e-9) << seed << " " << masses;
    }
  std::printf("%d of %d not solved\n", unsolved, compared);
  EXPECT_LE(unsolved, compared / 10);
}

// Without friction the velocities are unique: the condensed equations find those of all rows, also
// where each row without bounds is there twice.
TEST(CondensedCones, FindsTheVelocitiesOfAllRows) {
  for (unsigned seed = 1; seed <= 60; ++seed) {
    Walker walker(seed, 3 + static_cast<int>(seed) % 8, 100.0);
    for (BodyConeProblem::Row& row : walker.problem.rows) row.friction = 0.0;
    Blocks of(walker.problem);
    CondensedCones condensed;
    ASSERT_TRUE(condensed.set(of.blocks));
    BodyEquations all;
    all.set(of.blocks);
    List<double> p(walker.problem.rows.size(), 0.0), q = p;
    EXPECT_LE(solve(&condensed, &of, &p), 1e-10) << seed;
    EXPECT_LE(solve(&all, &of, &q), 1e-9) << seed;
    List<Twist> v_p, v_q;
    of.blocks.set_velocities(p, &v_p);
    of.blocks.set_velocities(q, &v_q);

    BodyConeProblem twice = walker.problem;
    std::size_t begin = 0;
    for (const BodyConeProblem::Row& row : walker.problem.rows) {
      if (row.kind == Kind::kSingle && row.most == kInfinity) {
        for (std::size_t k = begin; k < row.parts_end; ++k)
          twice.parts.push_back(walker.problem.parts[k]);
        BodyConeProblem::Row again = row;
        again.parts_end = twice.parts.size();
        twice.rows.push_back(again);
      }
      begin = row.parts_end;
    }
    Blocks of_twice(twice);
    CondensedCones redundant;
    ASSERT_TRUE(redundant.set(of_twice.blocks));
    List<double> r(twice.rows.size(), 0.0);
    EXPECT_LE(solve(&redundant, &of_twice, &r), 1e-10) << seed;
    List<Twist> v_r;
    of_twice.blocks.set_velocities(r, &v_r);
    for (std::size_t body = 0; body < v_p.size(); ++body) {
      EXPECT_LT((v_p[body] - v_q[body]).norm(), 1e-6) << seed << " " << body;
      EXPECT_LT((v_p[body] - v_r[body]).norm(), 1e-6) << seed << " " << body;
    }
  }
}

// A row with bounds along a row without them can change nothing, and gets no impulse; the others
// are solved.
TEST(CondensedCones, LeavesOutWhatRowsWithoutBoundsHold) {
  Walker walker(5, 6, 10.0);
  BodyConeProblem& problem = walker.problem;
  const BodyConeProblem::Row held = problem.rows[0];
  const BodyConeProblem::Part first = problem.parts[0], second = problem.parts[1];
  problem.parts.push_back(first);
  problem.parts.push_back(second);
  BodyConeProblem::Row limit = held;
  limit.least = 0.0;
  limit.parts_end = problem.parts.size();
  problem.rows.push_back(limit);
  Blocks of(problem);
  CondensedCones equations;
  ASSERT_TRUE(equations.set(of.blocks));
  List<double> p(problem.rows.size(), 0.0);
  EXPECT_LE(solve(&equations, &of, &p), 1e-10);
  EXPECT_EQ(p.back(), 0.0);
  EXPECT_LE(of.residual(p), 1e-9);
}

// Rows without bounds that contradict each other cannot all hold: the elimination leaves one out,
// and the solver tells the residual of all.
TEST(CondensedCones, TellTheResidualOfContradictingRows) {
  for (unsigned seed = 1; seed <= 20; ++seed) {
    Walker walker(seed, 6, 10.0);
    BodyConeProblem& problem = walker.problem;
    BodyConeProblem::Row again = problem.rows[0];
    const BodyConeProblem::Part first = problem.parts[0], second = problem.parts[1];
    problem.parts.push_back(first);
    problem.parts.push_back(second);
    again.rate += 0.1;
    again.parts_end = problem.parts.size();
    problem.rows.push_back(again);
    Blocks of(problem);
    ASSERT_TRUE(CondensedCones().set(of.blocks));
    List<double> p(problem.rows.size(), 0.0);
    const BodyConeSolver::Outcome outcome =
        BodyConeSolver().solve(problem, {1e-9, 0.0, 400}, nullptr, &p);
    EXPECT_EQ(outcome.residual, of.residual(p)) << seed;
    EXPECT_GT(outcome.residual, 0.04) << seed;  // half of the contradiction, or more
  }
}

/// Corrections of a step: the rows of the velocities without tangents, with other rates.
BodyConeProblem corrections_of(const BodyConeProblem& velocities, Draw* draw) {
  BodyConeProblem problem;
  problem.bodies = velocities.bodies;
  std::size_t part = 0;
  for (BodyConeProblem::Row row : velocities.rows) {
    const std::size_t end = row.parts_end;
    if (row.kind != Kind::kTangent)
      problem.parts.insert(problem.parts.end(),
                           velocities.parts.begin() + static_cast<std::ptrdiff_t>(part),
                           velocities.parts.begin() + static_cast<std::ptrdiff_t>(end));
    part = end;
    if (row.kind == Kind::kTangent) continue;
    if (row.kind == Kind::kNormal) row.least = 0.0;
    row.kind = Kind::kSingle;
    row.rate = 0.1 * (*draw)();
    row.parts_end = problem.parts.size();
    problem.rows.push_back(row);
  }
  return problem;
}

// Factors that are kept give the same bits as new ones: for other rates, for fewer rows, and where
// a mass changes, for which factors are computed anew.
TEST(RowElimination, KeepsFactorsWithoutATrace) {
  RowElimination kept;
  for (unsigned seed = 0; seed < 20; ++seed) {
    Walker walker(seed, 7, 1e3);
    List<BodyConeProblem> problems{walker.problem, corrections_of(walker.problem, &walker.draw),
                                   corrections_of(walker.problem, &walker.draw), walker.problem};
    problems.push_back(problems[1]);
    problems.back().bodies[3].inverse_mass *= 1.25;
    for (std::size_t k = 0; k < problems.size(); ++k) {
      const Blocks of(problems[k]);
      RowElimination anew;
      ASSERT_TRUE(kept.set(of.blocks));
      ASSERT_TRUE(anew.set(of.blocks));
      EXPECT_EQ(kept.A(), anew.A()) << seed << " " << k;
      EXPECT_EQ(kept.b(), anew.b()) << seed << " " << k;
      List<double> x(kept.size()), p, expected;
      for (double& value : x) value = walker.draw();
      kept.expand(x, &p);
      anew.expand(x, &expected);
      EXPECT_EQ(p, expected) << seed << " " << k;
    }
  }
}

}  // namespace
}  // namespace constraint_sim::engine
