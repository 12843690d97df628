// Impacts whose impulses are not unique, and the rates that depend on them. Oracles: other
// solutions of the same impact, found by fixed-point iterations, and closed forms.

#include <Eigen/LU>

#include "by_events.h"
#include "engine/math/cone_solver.h"
#include "engine/math/impulse_sharing.h"
#include "support.h"

namespace constraint_sim::engine {
namespace {

using Eigen::MatrixXd;
using Eigen::Vector2d;
using Eigen::Vector3d;
using Eigen::VectorXd;

/// A box that meets a floor with its lower corners, and its problem.
struct Landing {
  ConeProblem problem;
  MatrixXd A;
  VectorXd b;

  /// `half`: half the sizes [m]; `spin`: rate about the vertical axis.
  Landing(const Vector3d& half, double friction, const Vector3d& velocity, double spin,
          Eigen::Index corners) {
    const Vector3d squares = half.cwiseProduct(half);
    MatrixXd J(3 * corners, 6);
    for (Eigen::Index i = 0; i < corners; ++i) {
      const Vector3d r(i % 2 == 0 ? half.x() : -half.x(), i < 2 ? half.y() : -half.y(), -half.z());
      const Vector3d axes[] = {Vector3d::UnitZ(), Vector3d::UnitX(), Vector3d::UnitY()};
      for (Eigen::Index k = 0; k < 3; ++k)
        J.row(3 * i + k) << axes[k].transpose(), r.cross(axes[k]).transpose();
    }
    VectorXd inverse(6), motion(6);  // inverse masses and twist of a box of 1 kg
    inverse << 1.0, 1.0, 1.0, 3.0 / (squares.y() + squares.z()), 3.0 / (squares.x() + squares.z()),
        3.0 / (squares.x() + squares.y());
    motion << velocity, 0.0, 0.0, spin;
    A = J * inverse.asDiagonal() * J.transpose();
    b = J * motion;
    problem.A.assign(A.data(), A.data() + A.size());
    problem.b.assign(b.data(), b.data() + b.size());
    problem.contacts.assign(static_cast<std::size_t>(corners), {friction, false, {}});
  }

  double indeterminate() const {
    List<double> p;
    SolveEffort effort;
    EXPECT_TRUE(ConeSolver().solve(problem, &p, &effort));
    return ImpulseSharing().indeterminate_rate(problem, p);
  }

  /// Returns impulses on four corners whose part along (1, −1, −1, 1) is `share`; all corners slip.
  VectorXd with_share(double share) const {
    VectorXd p = VectorXd::Zero(12);
    for (int k = 0; k < 60; ++k) {
      const VectorXd u = b + A * p;
      MatrixXd F = MatrixXd::Zero(12, 4), normals = MatrixXd::Zero(4, 12);
      for (Eigen::Index i = 0; i < 4; ++i) {
        F(3 * i, i) = normals(i, 3 * i) = 1.0;
        F.block<2, 1>(3 * i + 1, i) =
            -problem.contacts[0].friction * u.segment<2>(3 * i + 1).normalized();
      }
      MatrixXd M(5, 4);
      M << normals * A * F, 1.0, -1.0, -1.0, 1.0;
      VectorXd right(5);
      right << -normals * b, share;
      const Eigen::Matrix4d square = M.transpose() * M;
      p = F * square.inverse() * (M.transpose() * right);
    }
    return p;
  }
};

double most_rate(const VectorXd& rates) { return rates.lpNorm<Eigen::Infinity>(); }

// The estimate is between a fifth of the largest difference of two solutions and twice it: slips
// turn with the change, and the solution is between the two.
TEST(ImpulseSharing, BoundsTheDifferencesOfSlidingAndRotatingBoxes) {
  Random random;
  int compared = 0;
  for (int k = 0; k < (kIsLongRun ? 2000 : 60); ++k) {
    const auto size = [&] { return 0.15 + 0.3 * random.share(); };
    const Vector3d half(size(), size(), 0.3 * size());
    const Vector3d velocity(1.0 + random.share(), random(), -1.0 - random.share());
    const Landing landing(half, 0.05 + 0.15 * random.share(), velocity, 3.0 * random(), 4);
    VectorXd least, most;
    const auto is_solution = [&](const VectorXd& p) {
      const VectorXd u = landing.b + landing.A * p;
      for (Eigen::Index i = 0; i < 4; ++i)
        if (p[3 * i] < 0.0 || std::abs(u[3 * i]) > 1e-9 ||
            (p.segment<2>(3 * i + 1) +
             landing.problem.contacts[0].friction * p[3 * i] * u.segment<2>(3 * i + 1).normalized())
                    .norm() > 1e-6)
          return false;
      return true;
    };
    const double largest = -velocity.z();
    for (double share = -largest; share <= largest; share += 0.04 * largest) {
      const VectorXd p = landing.with_share(share);
      if (!is_solution(p)) continue;
      if (least.size() == 0) least = p;
      most = p;
    }
    if (least.size() == 0) continue;  // a corner stops or the box tips
    const double difference = most_rate(landing.A * (most - least));
    const double estimate = landing.indeterminate();
    EXPECT_GT(estimate, 0.2 * difference) << k;
    // unless the iterations end before the sharing does: a step of shares is 0.01 per corner
    const auto ends = [&](const VectorXd& p) {
      return std::min({p[0], p[3], p[6], p[9]}) < 0.011 * largest;
    };
    if (ends(least) && ends(most)) {
      EXPECT_LT(estimate, 2.0 * difference + 1e-3) << k;
    }
    ++compared;
  }
  EXPECT_GT(compared, 30);
}

// Corners with equal slips: the forces of any sharing have the sum and the torque of any other.
TEST(ImpulseSharing, VanishesForABoxThatOnlySlides) {
  EXPECT_LT(Landing({0.3, 0.2, 0.1}, 0.2, {2.0, 0.7, -1.0}, 0.0, 4).indeterminate(), 1e-12);
}

// Three corners have unique loads.
TEST(ImpulseSharing, VanishesOnThreeCorners) {
  EXPECT_EQ(Landing({0.3, 0.2, 0.1}, 0.1, {2.0, 0.7, -1.0}, 2.0, 3).indeterminate(), 0.0);
}

// Corners that stick do not move by any sharing.
TEST(ImpulseSharing, VanishesWhereAllCornersStick) {
  EXPECT_EQ(Landing({0.3, 0.2, 0.05}, 0.9, {0.1, 0.0, -1.0}, 0.1, 4).indeterminate(), 0.0);
}

class ImpulseSharingAt : public testing::TestWithParam<Carried> {};

INSTANTIATE_TEST_SUITE_P(Ticks, ImpulseSharingAt,
                         testing::ValuesIn(each_setting(Method::kEventDriven)));

// A box lands on four corners: the step reports the open sharing where it also rotates, and none
// where it only slides.
TEST_P(ImpulseSharingAt, ALandingBoxReportsIt) {
  for (const double spin : {0.0, 2.0}) {
    World world(by_events(GetParam()));
    world.add_body(with_surface(make_floor(0.0), 0.2, 0.0));
    Body box = with_surface(make_body("box", Box{{0.6, 0.4, 0.1}}, 2.0, {0.0, 0.0, 0.1}), 0.2, 0.0);
    box.state.linear_velocity = {1.5, 0.5, 0.0};
    box.state.angular_velocity.z() = spin;
    world.add_body(box);
    double largest = 0.0;
    while (world.time() < 0.15) largest = std::max(largest, world.step().local_error);
    if (spin == 0.0)
      EXPECT_LT(largest, 1e-12);
    else
      EXPECT_GT(largest, 1e-4 * world.options().time_step);  // velocities are some 1e-2 m/s
  }
}

}  // namespace
}  // namespace constraint_sim::engine
