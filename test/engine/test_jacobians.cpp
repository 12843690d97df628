// Each row's Jacobian against central differences of C along generalized velocities.

#include <functional>

#include "engine/collision/narrowphase.h"
#include "engine/constraints/contact.h"
#include "engine/constraints/distance.h"
#include "support.h"

namespace constraint_sim::engine {
namespace {

using Eigen::Vector3d;

constexpr int kJacobianTrials = 200;

// Central differences have an error of kStep² C''' (below 1e-9 for distances above 0.3 m) and of
// the rounding of C over the step (1e-15 / 1e-5).
constexpr double kDifferenceStep = 1e-5;
constexpr double kTolerance = 2e-9;

void expect_gradient(const std::function<double(const PairPose&)>& C, const PairPose& pose,
                     const Jacobian& J) {
  const Vector3d zero = Vector3d::Zero();
  const auto slope = [&](const Vector3d& v_A, const Vector3d& w_A, const Vector3d& v_B,
                         const Vector3d& w_B) {
    const auto at = [&](double step) {
      return C({moved(pose.a, v_A, w_A, step), moved(pose.b, v_B, w_B, step)});
    };
    return (at(kDifferenceStep) - at(-kDifferenceStep)) / (2.0 * kDifferenceStep);
  };
  for (int i = 0; i < 3; ++i) {
    const Vector3d e = Vector3d::Unit(i);
    EXPECT_NEAR(J.j1[i], slope(e, zero, zero, zero), kTolerance);
    EXPECT_NEAR(J.j2[i], slope(zero, e, zero, zero), kTolerance);
    EXPECT_NEAR(J.j3[i], slope(zero, zero, e, zero), kTolerance);
    EXPECT_NEAR(J.j4[i], slope(zero, zero, zero, e), kTolerance);
  }
}

Vector3d point_of(const BodyState& body, const Vector3d& anchor) {
  return body.position + body.orientation * anchor;
}

/// Returns the position, in another pose, of the body's point that is at p now.
Vector3d carried(const BodyState& now, const Vector3d& p, const BodyState& then) {
  return point_of(then, now.orientation.conjugate() * (p - now.position));
}

struct Joined {
  Joint joint;
  PairPose pose;

  Vector3d d(const PairPose& at) const {
    return point_of(at.b, joint.anchor_b) - point_of(at.a, joint.anchor_a);
  }
};

Joined random_distance_joint(Random* random) {
  Joined joined;
  do {
    joined.joint.anchor_a = random->vector();
    joined.joint.anchor_b = random->vector();
    joined.pose.a = random->state();
    joined.pose.b = random->state();
  } while (joined.d(joined.pose).norm() < 0.3);
  return joined;
}

TEST(Jacobians, DistanceRow) {
  Random random;
  for (int trial = 0; trial < kJacobianTrials; ++trial) {
    const Joined joined = random_distance_joint(&random);
    const double travel = 0.1 * random();
    const auto C = [&](const PairPose& at) { return joined.d(at).norm() - 0.8 - travel; };
    Row rows[3];
    ASSERT_EQ(
        write_distance_rows(rod(0.8), {joined.joint, joined.pose.a, joined.pose.b}, travel, rows),
        1);
    EXPECT_NEAR(rows[0].C, C(joined.pose), 8 * kEpsilon);
    expect_gradient(C, joined.pose, rows[0].J);
  }
}

TEST(Jacobians, RowsOfLimits) {
  Random random;
  for (int trial = 0; trial < kJacobianTrials; ++trial) {
    const Joined joined = random_distance_joint(&random);
    const double travel = 0.1 * random();
    const auto C_max = [&](const PairPose& at) { return joined.d(at).norm() - 1.5 - travel; };
    const auto C_min = [&](const PairPose& at) { return joined.d(at).norm() - 0.8 - travel; };
    Row rows[3];
    ASSERT_EQ(write_distance_rows(between(0.8, 1.5), {joined.joint, joined.pose.a, joined.pose.b},
                                  travel, rows),
              2);
    EXPECT_NEAR(rows[0].C, C_max(joined.pose), 8 * kEpsilon);
    EXPECT_EQ(rows[0].upper, 0.0);
    EXPECT_EQ(rows[0].lower, -kInfinity);
    expect_gradient(C_max, joined.pose, rows[0].J);
    EXPECT_NEAR(rows[1].C, C_min(joined.pose), 8 * kEpsilon);
    EXPECT_EQ(rows[1].lower, 0.0);
    EXPECT_EQ(rows[1].upper, kInfinity);
    expect_gradient(C_min, joined.pose, rows[1].J);
  }
}

TEST(Jacobians, ASpringBetweenLimitsHasMostRows) {
  DistanceJoint bounded = between(0.8, 1.5);
  bounded.length = 1.0;
  bounded.stiffness = 10.0;
  Random random;
  const Joined joined = random_distance_joint(&random);
  Row rows[kMaxDistanceRows + 1];
  EXPECT_EQ(write_distance_rows(bounded, {joined.joint, joined.pose.a, joined.pose.b}, 0.0, rows),
            kMaxDistanceRows);
}

// J V is the rate of the anchors' distance under the velocities: the tutorial's C-dot.
TEST(Jacobians, TimesVelocitiesIsTheRateOfTheDistance) {
  Random random;
  for (int trial = 0; trial < kJacobianTrials; ++trial) {
    const Joined joined = random_distance_joint(&random);
    const BodyState& a = joined.pose.a;
    const BodyState& b = joined.pose.b;
    Row row[3];
    write_distance_rows(rod(1.0), {joined.joint, a, b}, 0.0, row);
    const auto C = [&](double t) {
      return joined
          .d({moved(a, a.linear_velocity, a.angular_velocity, t),
              moved(b, b.linear_velocity, b.angular_velocity, t)})
          .norm();
    };
    EXPECT_NEAR(row[0].J.times(a.linear_velocity, a.angular_velocity, b.linear_velocity,
                               b.angular_velocity),
                (C(kDifferenceStep) - C(-kDifferenceStep)) / (2.0 * kDifferenceStep),
                10.0 * kTolerance);
  }
}

struct RandomContact {
  PairPose pose;
  Vector3d normal;
  Manifold::Point point;

  explicit RandomContact(Random* random) {
    pose = {random->state(), random->state()};
    normal = random->vector().normalized();
    point.position = random->vector();
    point.depth = 0.01;
  }

  /// Returns the rows with friction: normal and two tangents.
  std::vector<Row> rows() const {
    Body a, b;
    a.friction = b.friction = 0.5;
    std::vector<Row> rows(kMaxContactRows);
    const int count = write_contact_rows(pose.a, pose.b, normal, point, ContactSurface(a, 0, b, 0),
                                         {0.01, 0.1, kGravity}, Vector3d::Zero(), rows.data());
    EXPECT_EQ(count, 3);
    return rows;
  }
};

// C of a contact row is the displacement of A's point against B's along a fixed direction.
TEST(Jacobians, RowsOfAContact) {
  Random random;
  for (int trial = 0; trial < kJacobianTrials; ++trial) {
    const RandomContact contact(&random);
    for (const Row& row : contact.rows()) {
      const Vector3d along = row.J.j1;
      const auto C = [&](const PairPose& at) {
        return along.dot(carried(contact.pose.a, contact.point.position, at.a) -
                         carried(contact.pose.b, contact.point.position, at.b));
      };
      expect_gradient(C, contact.pose, row.J);
    }
  }
}

TEST(Jacobians, ContactDirectionsAreOrthonormal) {
  Random random;
  for (int trial = 0; trial < kJacobianTrials; ++trial) {
    const RandomContact contact(&random);
    const std::vector<Row> rows = contact.rows();
    EXPECT_EQ(rows[0].J.j1, contact.normal);
    for (int i = 0; i < 3; ++i) {
      for (int k = 0; k < 3; ++k)
        EXPECT_NEAR(rows[i].J.j1.dot(rows[k].J.j1), i == k ? 1.0 : 0.0, 8 * kEpsilon);
    }
  }
}

// The normal row is the gradient of the true gap, not only of material points.
TEST(Jacobians, NormalRowOfSpheresIsTheGradientOfTheirGap) {
  Random random;
  for (int trial = 0; trial < kJacobianTrials; ++trial) {
    PairPose pose{random.state(), random.state()};
    pose.b.position = pose.a.position + (0.6 + 0.3 * random()) * random.vector().normalized();
    const Manifold manifold = collide(Sphere{0.4}, pose.a, Sphere{0.7}, pose.b);
    ASSERT_EQ(manifold.count, 1);
    const auto gap = [](const PairPose& at) {
      return (at.a.position - at.b.position).norm() - 1.1;
    };
    Row row;
    const Body body;
    write_contact_rows(pose.a, pose.b, manifold.normal, manifold.points[0],
                       ContactSurface(body, 0, body, 0), {0.01, 0.1, kGravity}, Vector3d::Zero(),
                       &row);
    EXPECT_NEAR(row.C, gap(pose), 8 * kEpsilon);
    expect_gradient(gap, pose, row.J);
  }
}

}  // namespace
}  // namespace constraint_sim::engine
