// Contacts with friction between bodies, by ADMM and Newton's method: against closed forms and the
// dense solver.

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <array>
#include <atomic>
#include <cmath>

#include "draw.h"
#include "engine/math/body_cone_solver.h"
#include "engine/math/body_cone_sweeps.h"
#include "engine/math/cone_solver.h"
#include "engine/math/list.h"

namespace constraint_sim::engine {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;
using Kind = BodyConeProblem::Kind;
using Outcome = BodyConeSolver::Outcome;

constexpr double kTolerance = 1e-9;  // residual as a share of the largest rate without impulses
constexpr int kIterations = 400;

/// Cubes with contacts at corners, and the rates of a step under gravity.
class Cubes {
 public:
  static constexpr double kHalf = 0.1, kFall = 9.81 / 60.0;  // [m], [m/s]

  int add(double mass, const Vector3d& position, const Vector3d& velocity = Vector3d::Zero()) {
    BodyConeProblem::Body body;
    const double inertia = mass * 4.0 * kHalf * kHalf / 6.0;
    body.mass = mass;
    body.inverse_mass = 1.0 / mass;
    body.inertia = inertia * Matrix3d::Identity();
    body.inverse_inertia = Matrix3d::Identity() / inertia;
    problem.bodies.push_back(body);
    positions.push_back(position);
    velocities.push_back(velocity + fall);
    return static_cast<int>(problem.bodies.size()) - 1;
  }
  /// Adds a contact at `point` with the normal n on body a, from b, or from the floor for b = −1.
  void touch(int a, int b, const Vector3d& point, const Vector3d& n, double friction) {
    const Vector3d t = n.unitOrthogonal();
    for (const Vector3d& direction : {n, t, Vector3d(n.cross(t))}) {
      BodyConeProblem::Row row;
      row.kind = direction == n ? Kind::kNormal : Kind::kTangent;
      row.friction = direction == n ? friction : 0.0;
      if (b >= 0) add_part(b, -direction, point, &row);
      add_part(a, direction, point, &row);
      problem.rows.push_back(row);
    }
  }
  /// Adds contacts at the four lower corners of body a.
  void rest(int a, int b, double friction) {
    for (const double x : {-kHalf, kHalf})
      for (const double y : {-kHalf, kHalf})
        touch(a, b, positions[a] + Vector3d(x, y, -kHalf), Vector3d::UnitZ(), friction);
  }
  Outcome solve() {
    p.resize(problem.rows.size(), 0.0);
    BodyConeSolver solver;
    return solver.solve(problem, {kTolerance, 0.0, kIterations}, nullptr, &p);
  }
  Vector3d impulse(std::size_t contact) const {
    return {p[3 * contact], p[3 * contact + 1], p[3 * contact + 2]};
  }
  double normal_sum(std::size_t contact, std::size_t count) const {
    double sum = 0.0;
    for (std::size_t i = contact; i < contact + count; ++i) sum += p[3 * i];
    return sum;
  }
  /// Returns the twist of a body after the step.
  BodyConeProblem::Twist twist_after(int body) const {
    BodyConeProblem::Twist sum = BodyConeProblem::Twist::Zero();
    std::size_t part = 0;
    for (std::size_t i = 0; i < problem.rows.size(); ++i)
      for (; part < problem.rows[i].parts_end; ++part)
        if (problem.parts[part].body == body) sum += p[i] * problem.parts[part].J;
    sum = problem.bodies[body].apply_inverse(sum);
    sum.head<3>() += velocities[body];
    return sum;
  }

  BodyConeProblem problem;
  List<Vector3d> positions, velocities;
  List<double> p;
  Vector3d fall{0.0, 0.0, -kFall};

 private:
  void add_part(int body, const Vector3d& direction, const Vector3d& point,
                BodyConeProblem::Row* row) {
    BodyConeProblem::Part part{body, {}};
    part.J << direction, (point - positions[body]).cross(direction);
    row->rate += direction.dot(velocities[body]);
    problem.parts.push_back(part);
    row->parts_end = problem.parts.size();
  }
};

Cubes tower(int n, double top) {
  Cubes cubes;
  for (int i = 0; i < n; ++i) {
    cubes.add(i + 1 == n ? top : 1.0, Vector3d(0.0, 0.0, Cubes::kHalf * (2 * i + 1)));
    cubes.rest(i, i - 1, 0.6);
  }
  return cubes;
}

// Each level carries the weight above it, in equal shares. A residual r leaves forces of r times
// the mass, and a level rests on as many others as there are below.
TEST(BodyCones, LevelsOfATowerCarryTheWeightAboveThem) {
  for (const int n : {1, 2, 5, 10, 20}) {
    for (const double top : {1e-3, 1.0, 1e3, 1e4, 1e6}) {
      Cubes cubes = tower(n, top);
      const Outcome outcome = cubes.solve();
      std::printf("n %d top %g: %d iterations, residual %.2e\n", n, top, outcome.iterations,
                  outcome.residual / outcome.scale);
      EXPECT_TRUE(outcome.is_within(kTolerance)) << n << " " << top << " " << outcome.residual;
      for (int i = 0; i < n; ++i) {
        const double weight = (top + n - 1 - i) * Cubes::kFall;
        const double rounding = 1e-7 * n * weight;
        EXPECT_NEAR(cubes.normal_sum(4 * i, 4), weight, rounding) << n << " " << top << " " << i;
        for (int k = 0; k < 4; ++k)
          EXPECT_NEAR(cubes.impulse(4 * i + k)[0], weight / 4.0, rounding) << n << " " << top;
      }
    }
  }
}

// The load of corners does not depend on where the iterations start. Equal shares are the least
// norm.
TEST(BodyCones, CornersShareALoadWhateverTheStart) {
  Draw draw(3);
  for (int k = 0; k < 50; ++k) {
    Cubes cubes = tower(2, 3.0);
    cubes.p.resize(cubes.problem.rows.size());
    for (double& p : cubes.p) p = draw();
    const Outcome outcome = cubes.solve();
    ASSERT_TRUE(outcome.is_within(kTolerance)) << k << " " << outcome.residual;
    for (int corner = 0; corner < 8; ++corner) {
      const double share = (corner < 4 ? 4.0 : 3.0) * Cubes::kFall / 4.0;
      EXPECT_NEAR(cubes.impulse(corner)[0], share, 1e-6 * share) << k << " " << corner;
      EXPECT_LT(cubes.impulse(corner).tail<2>().norm(), 1e-6 * share) << k << " " << corner;
    }
  }
}

// A millionth above the threshold of sliding moves the cube, a millionth below holds it.
TEST(BodyCones, ACubeOnASlopeSlidesFromTheThresholdOn) {
  for (const double friction : {0.1, 0.3, 0.6}) {
    for (const double share : {0.5, 1.0 - 1e-6, 1.0 + 1e-6, 1.2, 1.6}) {
      const double slope = share * friction;
      Cubes cubes;
      cubes.fall = Cubes::kFall * Vector3d(slope, 0.0, -1.0).normalized();
      cubes.add(1.0, {0.0, 0.0, Cubes::kHalf});
      cubes.rest(0, -1, friction);
      const Outcome outcome = cubes.solve();
      EXPECT_TRUE(outcome.is_within(kTolerance)) << friction << " " << share;
      const double speed =
          share < 1.0 ? 0.0
                      : cubes.fall.norm() / std::sqrt(1.0 + slope * slope) * (slope - friction);
      // the residual of four contacts, in a rate that friction does not reduce
      const double allowed = 10.0 * kTolerance * Cubes::kFall;
      EXPECT_NEAR(cubes.twist_after(0)[0], speed, allowed) << friction << " " << share;
      EXPECT_LT(cubes.twist_after(0).tail<5>().norm(), 100.0 * allowed) << friction << " " << share;
    }
  }
}

// Friction brakes straight against the motion, whatever the direction of the tangents.
TEST(BodyCones, ASlidingCubeIsBrakedAgainstItsMotion) {
  for (int k = 0; k < 12; ++k) {
    const double angle = 0.5 * k;
    const Vector3d direction(std::cos(angle), std::sin(angle), 0.0);
    Cubes cubes;
    cubes.add(1.0, {0.0, 0.0, Cubes::kHalf}, direction);
    cubes.rest(0, -1, 0.6);
    const Outcome outcome = cubes.solve();
    EXPECT_TRUE(outcome.is_within(kTolerance)) << k;
    const Vector3d v = cubes.twist_after(0).head<3>();
    EXPECT_LT((v - (1.0 - 0.6 * Cubes::kFall) * direction).norm(), 10.0 * kTolerance) << k;
    EXPECT_LT(cubes.twist_after(0).tail<3>().norm(), 100.0 * kTolerance) << k;
  }
}

// A stack that slides as a whole: friction of the floor brakes all, friction between the cubes
// carries its share of the braking.
TEST(BodyCones, ASlidingStackIsBrakedAsAWhole) {
  Cubes cubes;
  for (int i = 0; i < 3; ++i) {
    cubes.add(1.0, Vector3d(0.0, 0.0, Cubes::kHalf * (2 * i + 1)), Vector3d::UnitX());
    cubes.rest(i, i - 1, i == 0 ? 0.2 : 0.6);
  }
  const Outcome outcome = cubes.solve();
  EXPECT_TRUE(outcome.is_within(kTolerance));
  for (int i = 0; i < 3; ++i) {
    EXPECT_NEAR(cubes.twist_after(i)[0], 1.0 - 0.2 * Cubes::kFall, 20.0 * kTolerance) << i;
    double friction = 0.0;
    for (int corner = 4 * i; corner < 4 * i + 4; ++corner)
      friction += cubes.impulse(corner).tail<2>().norm();
    EXPECT_NEAR(friction, (3 - i) * 0.2 * Cubes::kFall, 1e-7) << i;
  }
}

/// Random cubes that overlap a floor and each other, with one to three contacts each.
Cubes heap(Draw* draw, int n) {
  Cubes cubes;
  const auto anywhere = [&] { return draw->vector(); };
  for (int i = 0; i < n; ++i)
    cubes.add(std::pow(10.0, (*draw)()), 0.3 * anywhere(), 0.2 * anywhere());
  for (int i = 0; i < n; ++i)
    for (int k = 0; k < 2; ++k) {
      const int other = k == 0 ? -1 : i - 1;
      if (k == 1 && i == 0) continue;
      const Vector3d n_up = (Vector3d::UnitZ() + 0.3 * anywhere()).normalized();
      cubes.touch(i, other, cubes.positions[i] + 0.1 * anywhere(), n_up, 0.2 + 0.2 * draw->share());
    }
  return cubes;
}

TEST(BodyCones, RandomContactsMoveBodiesAsTheDenseSolverDoes) {
  Draw draw(8);
  int compared = 0;
  for (int k = 0; k < 300; ++k) {
    Cubes cubes = heap(&draw, 1 + k % 3);
    const Outcome outcome = cubes.solve();
    const auto n = static_cast<Eigen::Index>(cubes.problem.rows.size());
    const auto twists = static_cast<Eigen::Index>(6 * cubes.problem.bodies.size());
    Eigen::MatrixXd J = Eigen::MatrixXd::Zero(n, twists), inverse_mass(twists, twists);
    inverse_mass.setZero();
    ConeProblem dense;
    std::size_t part = 0;
    for (Eigen::Index i = 0; i < n; ++i) {
      const BodyConeProblem::Row& row = cubes.problem.rows[i];
      for (; part < row.parts_end; ++part)
        J.block<1, 6>(i, 6 * cubes.problem.parts[part].body) =
            cubes.problem.parts[part].J.transpose();
      dense.b.push_back(row.rate);
      if (row.kind == Kind::kNormal) dense.contacts.push_back({row.friction, false, {}});
    }
    for (Eigen::Index body = 0; body < twists / 6; ++body) {
      inverse_mass.block<3, 3>(6 * body, 6 * body) =
          cubes.problem.bodies[body].inverse_mass * Matrix3d::Identity();
      inverse_mass.block<3, 3>(6 * body + 3, 6 * body + 3) =
          cubes.problem.bodies[body].inverse_inertia;
    }
    const Eigen::MatrixXd A = J * inverse_mass * J.transpose();
    dense.A.assign(A.data(), A.data() + A.size());
    List<double> reference;
    SolveEffort effort;
    if (!ConeSolver().solve(dense, &reference, &effort)) continue;
    if (!outcome.is_within(kTolerance)) continue;
    const Eigen::Map<const Eigen::VectorXd> p(cubes.p.data(), n), q(reference.data(), n);
    const Eigen::VectorXd difference = inverse_mass * J.transpose() * (p - q);
    // residuals of 1e-9 times the conditioning of A, whose masses differ by up to a hundred
    EXPECT_LT(difference.norm(), 1e-5 * outcome.scale) << k;
    ++compared;
  }
  EXPECT_GT(compared, 280);  // problems out of 300 where both solvers end
}

// Neither the axes of the world nor the order of bodies and contacts matters beyond the tolerance.
TEST(BodyCones, RotationAndOrderDoNotMatter) {
  Draw draw(4);
  for (int k = 0; k < 30; ++k) {
    const Eigen::Quaterniond turn = k == 0 ? Eigen::Quaterniond(0.5, 0.5, 0.5, 0.5) : draw.turn();
    constexpr int kCount = 4;
    Cubes plain, turned;
    turned.fall = turn * plain.fall;
    std::array<int, kCount> bodies{};
    for (int i = 0; i < kCount; ++i) {
      const Vector3d position(0.05 * i, 0.02 * i, Cubes::kHalf * (2 * i + 1));
      plain.add(1.0 + i, position, Vector3d(0.3 * i, 0.0, 0.0));
    }
    for (int i = kCount - 1; i >= 0; --i)
      bodies[i] =
          turned.add(1.0 + i, turn * plain.positions[i], turn * Vector3d(0.3 * i, 0.0, 0.0));
    const auto corner = [&](int i, int c) -> Vector3d {
      return plain.positions[i] + Vector3d(c % 2 == 0 ? 0.1 : -0.1, c < 2 ? 0.1 : -0.1, -0.1);
    };
    for (int i = 0; i < kCount; ++i)
      for (int c = 0; c < 4; ++c) plain.touch(i, i - 1, corner(i, c), Vector3d::UnitZ(), 0.4);
    for (int i = kCount - 1; i >= 0; --i)
      for (int c = 3; c >= 0; --c)
        turned.touch(bodies[i], i == 0 ? -1 : bodies[i - 1], turn * corner(i, c),
                     turn * Vector3d::UnitZ(), 0.4);
    EXPECT_TRUE(plain.solve().is_within(kTolerance));
    EXPECT_TRUE(turned.solve().is_within(kTolerance));
    for (int i = 0; i < kCount; ++i) {
      const Vector3d v = turn * plain.twist_after(i).head<3>();
      EXPECT_LT((v - turned.twist_after(bodies[i]).head<3>()).norm(), 1e-7) << k << " " << i;
    }
  }
}

// Rows without bounds hold to the tolerance, however redundant they are: two cubes side by side,
// welded twice, on a floor without friction under the first.
TEST(BodyCones, JointsHoldBesideContacts) {
  Cubes cubes;
  cubes.add(1.0, {0.0, 0.0, Cubes::kHalf});
  cubes.add(2.0, {0.2, 0.0, Cubes::kHalf});
  cubes.rest(0, -1, 0.0);
  cubes.rest(1, -1, 0.0);
  for (int twice = 0; twice < 2; ++twice)
    for (int axis = 0; axis < 6; ++axis) {
      BodyConeProblem::Part first{0, {}}, second{1, {}};
      first.J.setZero();
      first.J[axis] = 1.0;
      second.J = -first.J;
      // the point in the middle moves with both
      const Vector3d arm(0.1, 0.0, 0.0);
      if (axis < 3) {
        first.J.tail<3>() = arm.cross(Vector3d::Unit(axis));
        second.J.tail<3>() = -(-arm).cross(Vector3d::Unit(axis));
      }
      BodyConeProblem::Row row;
      cubes.problem.parts.push_back(first);
      cubes.problem.parts.push_back(second);
      row.parts_end = cubes.problem.parts.size();
      row.rate =
          first.J.head<3>().dot(cubes.velocities[0]) + second.J.head<3>().dot(cubes.velocities[1]);
      cubes.problem.rows.push_back(row);
    }
  const Outcome outcome = cubes.solve();
  EXPECT_TRUE(outcome.is_within(kTolerance)) << outcome.residual;
  EXPECT_NEAR(cubes.normal_sum(0, 8), 3.0 * Cubes::kFall, 1e-8);
  for (int i = 0; i < 2; ++i) EXPECT_LT(cubes.twist_after(i).norm(), 1e-8) << i;
  for (int axis = 0; axis < 6; ++axis)  // two equal rows carry half each
    EXPECT_NEAR(cubes.p[24 + axis], cubes.p[30 + axis], 1e-7) << axis;
}

// A spring and a bounded row, in closed form: p = −b/(A + softness), and the bound.
TEST(BodyCones, SoftAndBoundedRowsHaveTheirClosedForm) {
  for (const double softness : {0.0, 1e-3, 0.5, 1e3}) {
    for (const double most : {0.05, 10.0}) {
      Cubes cubes;
      cubes.add(2.0, Vector3d::Zero());
      BodyConeProblem::Part part{0, {}};
      part.J << 0.0, 0.0, 1.0, 0.0, 0.0, 0.0;
      BodyConeProblem::Row row;
      row.rate = -Cubes::kFall;
      row.softness = softness;
      row.least = -most;
      row.most = most;
      cubes.problem.parts.push_back(part);
      row.parts_end = 1;
      cubes.problem.rows.push_back(row);
      const Outcome outcome = cubes.solve();
      EXPECT_TRUE(outcome.is_within(kTolerance)) << softness << " " << most;
      const double expected = std::min(most, Cubes::kFall / (0.5 + softness));
      EXPECT_NEAR(cubes.p[0], expected, 1e-8 * expected) << softness << " " << most;
    }
  }
}

// Clusters of 40 bodies in motion, masses over three decades, each body in contact with the ones
// before it in random directions: the alternations solve few of them.
TEST(BodyCones, NewtonSolvesClustersInMotion) {
  Draw draw(11);
  constexpr int kBodies = 40, kClusters = 20;
  int beyond_alternations = 0;
  for (int k = 0; k < kClusters; ++k) {
    Cubes cubes;
    for (int i = 0; i < kBodies; ++i) {
      cubes.add(std::pow(10.0, 1.5 * draw()), Cubes::kHalf * Vector3d(i, draw(), draw()),
                Vector3d(draw(), draw(), draw()));
      for (int other = std::max(i - 3, -1); other < i; ++other)
        cubes.touch(i, other, cubes.positions[i] + Cubes::kHalf * Vector3d(draw(), draw(), draw()),
                    Vector3d(draw(), draw(), draw()).normalized(), 0.5);
    }
    const Outcome outcome = cubes.solve();
    EXPECT_TRUE(outcome.is_within(kTolerance)) << k << " " << outcome.residual;
    if (outcome.iterations > 50) ++beyond_alternations;
  }
  EXPECT_GT(beyond_alternations, kClusters / 2);
}

// Impulses of BodyConeSweeps, and what they reach.
struct Swept {
  double before;    ///< residual of p = 0 [m/s]
  double residual;  ///< residual as returned [m/s]
  double after;     ///< residual of the impulses [m/s]
  int sweeps;
};

Swept sweep(double enough, Cubes* cubes) {
  cubes->p.assign(cubes->problem.rows.size(), 0.0);
  BodyConeBlocks blocks;
  blocks.set(cubes->problem);
  List<BodyConeProblem::Twist> v(cubes->problem.bodies.size());
  BodyConeSweeps sweeps;
  Swept swept;
  swept.before = blocks.residual(cubes->p, &v);
  swept.residual = sweeps.solve(blocks, enough, swept.before, nullptr, &cubes->p);
  swept.after = blocks.residual(cubes->p, &v);
  swept.sweeps = sweeps.sweeps();
  return swept;
}

// Each cube has one contact, through its centre, and slides: p_n = m v_n, and friction μ p_n acts
// against the slip.
TEST(BodyCones, OneSweepSolvesContactsThatShareNoBody) {
  Cubes cubes;
  for (int i = 0; i < 3; ++i) {
    const int cube = cubes.add(1.0 + i, Vector3d(i, 0.0, 0.0), Vector3d(3.0, 4.0, -1.0));
    cubes.touch(cube, -1, cubes.positions[cube], Vector3d::UnitZ(), 0.5);
  }
  const Swept swept = sweep(1e-12, &cubes);
  EXPECT_LE(swept.sweeps, 2);
  EXPECT_LE(swept.residual, 1e-12);
  for (int i = 0; i < 3; ++i) {
    const double normal = (1.0 + i) * (1.0 + Cubes::kFall);
    const auto twist = cubes.twist_after(i);
    EXPECT_NEAR(cubes.impulse(i)[0], normal, 1e-12 * normal);
    EXPECT_NEAR(twist[0], 3.0 - 0.6 * 0.5 * (1.0 + Cubes::kFall), 1e-12);
    EXPECT_NEAR(twist[1], 4.0 - 0.8 * 0.5 * (1.0 + Cubes::kFall), 1e-12);
  }
}

// Residuals are those of the impulses that are returned, and never above that of the given ones.
TEST(BodyCones, SweepsTellTheResidualThatTheyReached) {
  Draw draw(12);
  constexpr double kEnough = 1e-3;  // [m/s]
  int solved = 0;
  for (int k = 0; k < 100; ++k) {
    Cubes cubes;
    for (int i = 0; i < 8; ++i) {
      cubes.add(std::pow(10.0, draw()), Cubes::kHalf * Vector3d(i, draw(), draw()),
                Vector3d(draw(), draw(), draw()));
      for (int other = std::max(i - 2, -1); other < i; ++other)
        cubes.touch(i, other, cubes.positions[i] + Cubes::kHalf * Vector3d(draw(), draw(), draw()),
                    Vector3d(draw(), draw(), draw()).normalized(), 0.5);
    }
    const Swept swept = sweep(kEnough, &cubes);
    EXPECT_EQ(swept.residual, swept.after) << k;
    EXPECT_LE(swept.residual, swept.before) << k;
    if (swept.residual <= kEnough) ++solved;
  }
  std::printf("%d of 100 clusters solved by sweeps\n", solved);
  EXPECT_GE(solved, 50);
}

// Sweeps carry a change down a tower by one level each: 1e-9 m/s is out of reach, and is seen so.
TEST(BodyCones, SweepsGiveUpATowerEarly) {
  Cubes cubes = tower(20, 1e4);
  const Swept swept = sweep(1e-9, &cubes);
  EXPECT_GT(swept.residual, 1e-9);
  EXPECT_LE(swept.sweeps, 20);
}

// A top of 1e8 kg needs more than 50 iterations; a sufficient residual ends them earlier.
TEST(BodyCones, EndsAtASufficientResidual) {
  Cubes cubes = tower(20, 1e8);
  cubes.p.resize(cubes.problem.rows.size(), 0.0);
  List<double> p = cubes.p;
  const Outcome all =
      BodyConeSolver().solve(cubes.problem, {kTolerance, 0.0, kIterations}, nullptr, &p);
  ASSERT_GT(all.iterations, 50);
  constexpr double kSufficient = 1e-2;  // [m/s]
  const Outcome part = BodyConeSolver().solve(cubes.problem, {kTolerance, kSufficient, kIterations},
                                              nullptr, &cubes.p);
  EXPECT_LT(part.iterations, all.iterations);
  EXPECT_LE(part.residual, kSufficient);
}

TEST(BodyCones, TellsTheResidualThatItReached) {
  Cubes cubes = tower(10, 1e4);
  cubes.p.resize(cubes.problem.rows.size(), 0.0);
  BodyConeSolver solver;
  const Outcome few = solver.solve(cubes.problem, {kTolerance, 0.0, 3}, nullptr, &cubes.p);
  EXPECT_FALSE(few.is_within(kTolerance));
  List<double> again = cubes.p;
  const Outcome none = solver.solve(cubes.problem, {kTolerance, 0.0, 0}, nullptr, &again);
  EXPECT_EQ(none.residual, few.residual);  // residual of the impulses that were returned
  EXPECT_EQ(again, cubes.p);
  const std::atomic<bool> stop{true};
  const Outcome stopped =
      solver.solve(cubes.problem, {kTolerance, 0.0, kIterations}, &stop, &again);
  EXPECT_EQ(stopped.iterations, 0);
  const Outcome rest = solver.solve(cubes.problem, {kTolerance, 0.0, kIterations}, nullptr, &again);
  EXPECT_TRUE(rest.is_within(kTolerance));
  const Outcome known =
      solver.solve(cubes.problem, {kTolerance, 0.0, kIterations}, nullptr, &again);
  EXPECT_EQ(known.iterations, 0);
}

}  // namespace
}  // namespace constraint_sim::engine
