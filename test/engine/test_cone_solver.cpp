// Contacts with friction, single and coupled: against references, and their cost.

#include <gtest/gtest.h>

#include <Eigen/Eigenvalues>
#include <Eigen/Geometry>
#include <atomic>
#include <cmath>

#include "draw.h"
#include "engine/math/cone_solver.h"
#include "engine/math/list.h"
#include "support.h"

namespace constraint_sim::engine {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;

/// Returns the impulse of a slipping contact, in long double, by 400 bisections of κ.
Vector3d slipping_impulse(const Matrix3d& A, const Vector3d& b, double mu) {
  using Real = long double;
  using Vector = Eigen::Matrix<Real, 2, 1>;
  const Eigen::Matrix<Real, 3, 3> M = A.cast<Real>();
  const Eigen::Matrix<Real, 3, 1> r = b.cast<Real>();
  const Vector row = M.block<1, 2>(0, 1).transpose() / M(0, 0);
  const Eigen::Matrix<Real, 2, 2> S = M.block<2, 2>(1, 1) - M.block<2, 1>(1, 0) * row.transpose();
  const Vector c = r.tail<2>() - M.block<2, 1>(1, 0) * r[0] / M(0, 0);
  const auto impulse = [&](Real kappa) {
    Eigen::Matrix<Real, 2, 2> K = S;
    K.diagonal().array() += kappa;
    const Real det = K(0, 0) * K(1, 1) - K(0, 1) * K(1, 0);
    const Vector p{(-K(1, 1) * c[0] + K(0, 1) * c[1]) / det,
                   (K(1, 0) * c[0] - K(0, 0) * c[1]) / det};
    return Eigen::Matrix<Real, 3, 1>{-r[0] / M(0, 0) - row.dot(p), p[0], p[1]};
  };
  Real low = 0.0L, high = 1e40L;
  for (int i = 0; i < 400; ++i) {
    const Real middle = low > 0.0L ? std::sqrt(low * high) : high * 1e-60L;
    const auto p = impulse(middle);
    (p.tail<2>().norm() > mu * p[0] ? low : high) = middle;
  }
  return impulse(high).cast<double>();
}

// Rates over 16 orders of magnitude, friction over 9, responses over 6 and up to singular.
TEST(ConeSolver, AContactThatSlipsIsTheOneOfLongDouble) {
  Draw draw(5);
  int slipping = 0;
  for (int k = 0; k < 20000; ++k) {
    Matrix3d root;
    for (int i = 0; i < 9; ++i) root(i / 3, i % 3) = draw();
    const double flat = std::pow(10.0, -3.0 * draw.share());
    root.col(k % 3) *= flat;
    const Matrix3d A = std::pow(10.0, 6.0 * draw()) * root * root.transpose();
    Vector3d b{-draw.share(), draw(), draw()};
    b.tail<2>() *= std::pow(10.0, 8.0 * draw());
    const double mu = std::pow(10.0, -6.0 + 9.0 * draw.share());
    Vector3d p;
    if (!solve_contact(A, b, {mu, false, {}}, &p)) continue;
    if (p.tail<2>().norm() < (1.0 - 1e-12) * mu * p[0]) continue;  // sticks
    ++slipping;
    const Vector3d reference = slipping_impulse(A, b, mu);
    // A is singular to 1e-6, which costs six of sixteen digits, and one more where p_n ends near 0
    EXPECT_LT((p - reference).norm(), 1e-9 * reference.norm()) << k;
  }
  EXPECT_GT(slipping, 5000);
}

/// A box of 1 kg at rest on a floor with a box of `mass` on top, four points each.
ConeProblem column(double mass) {
  const double half = 0.15;
  const auto inverse = [&](double m) {
    Eigen::Matrix<double, 6, 1> all;
    all.head<3>().setConstant(1.0 / m);
    all.tail<3>().setConstant(6.0 / (m * 4.0 * half * half));
    return all;
  };
  Eigen::Matrix<double, 12, 1> weights;
  weights << inverse(1.0), inverse(mass);
  Eigen::Matrix<double, 24, 12> J = Eigen::Matrix<double, 24, 12>::Zero();
  const auto add = [&](int row, int body, double sign, const Vector3d& r) {
    int k = 0;
    for (const Vector3d& d : {Vector3d(0, 0, 1), Vector3d(1, 0, 0), Vector3d(0, 1, 0)}) {
      J.block<1, 3>(row + k, 6 * body) = sign * d.transpose();
      J.block<1, 3>(row + k, 6 * body + 3) = sign * r.cross(d).transpose();
      ++k;
    }
  };
  for (int i = 0; i < 4; ++i) {
    const double x = i % 2 == 0 ? half : -half, y = i < 2 ? half : -half;
    add(3 * i, 0, 1.0, {x, y, -half});
    add(12 + 3 * i, 1, 1.0, {x, y, -half});
    add(12 + 3 * i, 0, -1.0, {x, y, half});
  }
  ConeProblem problem;
  const Eigen::MatrixXd A = J * weights.asDiagonal() * J.transpose();
  problem.A.assign(A.data(), A.data() + A.size());
  Eigen::Matrix<double, 12, 1> fall = Eigen::Matrix<double, 12, 1>::Zero();
  fall[2] = fall[8] = -9.81;
  const Eigen::VectorXd b = J * fall;
  problem.b.assign(b.data(), b.data() + b.size());
  problem.contacts.assign(8, {0.5, false, Eigen::Vector2d::Zero()});
  return problem;
}

TEST(ConeSolver, AColumnOfAnyMassesCostsLittle) {
  for (const double mass : {1e-6, 1e-3, 1.0, 1e3, 1e6}) {
    const ConeProblem problem = column(mass);
    List<double> found;
    SolveEffort effort;
    ASSERT_TRUE(ConeSolver().solve(problem, &found, &effort)) << mass;
    const Eigen::Map<const Eigen::VectorXd> p(found.data(), 24), b(problem.b.data(), 24);
    const Eigen::Map<const Eigen::MatrixXd> A(problem.A.data(), 24, 24);
    EXPECT_LT(effort.spent, 300.0) << mass;  // a step has 1000
    double lower = 0.0, upper = 0.0;
    for (int i = 0; i < 4; ++i) {
      lower += p[3 * i];
      upper += p[12 + 3 * i];
      EXPECT_GE(p[3 * i], 0.0);
      EXPECT_LE(p.segment<2>(3 * i + 1).norm(), 0.5 * p[3 * i] * (1.0 + 1e-12));
    }
    // weights, within the tolerance of solve(), 1e-9
    EXPECT_NEAR(lower / (9.81 * (1.0 + mass)), 1.0, 1e-9) << mass;
    EXPECT_NEAR(upper / (9.81 * mass), 1.0, mass < 1.0 ? 1e-9 / mass : 1e-9) << mass;
    EXPECT_LT((b + A * p).lpNorm<Eigen::Infinity>(), 1e-8 * 9.81) << mass;
  }
}

TEST(ConeSolver, EndsWhereItsEffortIsOver) {
  const ConeProblem problem = column(1e6);
  List<double> p;
  SolveEffort little;
  little.most = 2.0;
  EXPECT_FALSE(ConeSolver().solve(problem, &p, &little));
  EXPECT_LT(little.spent, 4.0);  // the limit is exceeded by at most one Newton step
  const std::atomic<bool> flag{true};
  SolveEffort stopped;
  stopped.stop = &flag;
  EXPECT_FALSE(ConeSolver().solve(problem, &p, &stopped));
  EXPECT_EQ(stopped.spent, 0.0);
}

// A box of 1e6 kg rests on one of 1 kg, event-driven: the work limit of a step is sufficient.
TEST(ConeSolver, AHeavyBoxRestsOnALightOneByEvents) {
  World world;
  world.add_body(make_floor(0.5));
  const BodyId light =
      world.add_body(make_body("light", Box{{0.3, 0.3, 0.3}}, 1.0, {0.0, 0.0, 0.15}));
  const BodyId heavy =
      world.add_body(make_body("heavy", Box{{0.3, 0.3, 0.3}}, 1e6, {0.0, 0.0, 0.45}));
  for (int k = 0; k < 20; ++k) {
    world.step();
    for (const Island& island : world.islands())
      EXPECT_EQ(island.why, MethodReason::kFewContacts) << k;
  }
  EXPECT_NEAR(world.state(light).position.z(), 0.15, 1e-12);
  EXPECT_NEAR(world.state(heavy).position.z(), 0.45, 1e-12);
}

}  // namespace
}  // namespace constraint_sim::engine
