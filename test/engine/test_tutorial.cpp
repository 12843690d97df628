// Numbers of the tutorial: the constraint on a line, the worked example, the experiment.

#include "distance_1d.h"
#include "support.h"

namespace constraint_sim::engine {
namespace {

using Eigen::Vector3d;

// ---- the simple problem in one dimension

TEST(Distance1d, IsHalfTheDifferenceOfSquares) {
  EXPECT_EQ(distance_1d(5.0, 2.0, 3.0).C, 0.0);
  EXPECT_EQ(distance_1d(2.0, 5.0, 3.0).C, 0.0);
  EXPECT_EQ(distance_1d(5.0, 2.0, 1.0).C, 4.0);
}

TEST(Distance1d, JacobianIsTheGradient) {
  Random random;
  for (int trial = 0; trial < 100; ++trial) {
    const double x = 3.0 * random();
    const double y = 3.0 * random();
    const double L = 1.0 + random();
    const double step = 1e-2;
    const auto C = [&](double dx, double dy) { return distance_1d(x + dx, y + dy, L).C; };
    const Distance1d constraint = distance_1d(x, y, L);
    // central differences of a quadratic are exact except for the rounding of C ≤ 20 over the step
    const double tolerance = 20.0 * kEpsilon / step;
    EXPECT_NEAR((C(step, 0.0) - C(-step, 0.0)) / (2.0 * step), constraint.j_x, tolerance);
    EXPECT_NEAR((C(0.0, step) - C(0.0, -step)) / (2.0 * step), constraint.j_y, tolerance);
  }
}

// J = (2, -2), J V = 2·1 - 2·(-1) = 4, constraint mass 4/1 + 4/2 = 6
TEST(Distance1d, LambdaByHand) {
  const Distance1d constraint = distance_1d(3.0, 1.0, 2.0);
  EXPECT_DOUBLE_EQ(lambda_1d(constraint, 1.0, -1.0, 1.0, 2.0, 0.0, 0.5), -4.0 / 3.0);
  EXPECT_DOUBLE_EQ(lambda_1d(constraint, 1.0, -1.0, 1.0, 2.0, 7.0, 0.5), 1.0);
}

/// Two point masses on the x axis, joined by a rod of length L.
struct Line {
  double x = -0.7, y = 0.9, v_x = 0.3, v_y = -1.1, mass_x = 2.0, mass_y = 5.0, L = 1.6;

  /// Returns the velocities after one step of the tutorial's formula.
  Vector3d by_formula(double zeta, double h) const {
    const Distance1d c = distance_1d(x, y, L);
    const double lambda = lambda_1d(c, v_x, v_y, mass_x, mass_y, zeta, h);
    return {v_x + h * c.j_x * lambda / mass_x, v_y + h * c.j_y * lambda / mass_y, 0.0};
  }

  Vector3d by_world(double beta, double bias, double h) const {
    WorldOptions options = weightless(h);
    options.baumgarte = beta;
    World world(options);
    Body a = make_body("a", Point{}, mass_x, {x, 0.0, 0.0});
    Body b = make_body("b", Point{}, mass_y, {y, 0.0, 0.0});
    a.state.linear_velocity.x() = v_x;
    b.state.linear_velocity.x() = v_y;
    const BodyId id_a = world.add_body(a);
    const BodyId id_b = world.add_body(b);
    Joint joint = make_joint("line", id_a, Vector3d::Zero(), id_b, Vector3d::Zero(), rod(L));
    joint.motor.bias = bias;
    world.add_joint(joint);
    world.step();
    return {world.state(id_a).linear_velocity.x(), world.state(id_b).linear_velocity.x(), 0.0};
  }
};

// The world's row and its bias are the tutorial's divided by ‖d‖. The bound allows a dozen
// roundings of numbers up to 60.
constexpr double kRoundOff1d = 12 * 60 * kEpsilon;

TEST(Distance1d, WorldMovesTwoPointMassesInTheSameWay) {
  const Line line;
  EXPECT_LT((line.by_world(0.0, 0.0, 0.01) - line.by_formula(0.0, 0.01)).norm(), kRoundOff1d);
}

TEST(Distance1d, WorldMovesTwoPointMassesInTheSameWayWithABias) {
  const Line line;
  const double d = line.y - line.x;
  EXPECT_LT((line.by_world(0.0, 0.4, 0.01) - line.by_formula(0.4 * d, 0.01)).norm(), kRoundOff1d);
}

TEST(Distance1d, WorldMovesTwoPointMassesInTheSameWayWithBaumgarte) {
  Line line;
  line.L = 1.2;
  const double d = line.y - line.x;
  const double zeta = -0.1 / 0.01 * (d - line.L) * d;
  EXPECT_LT((line.by_world(0.1, 0.0, 0.01) - line.by_formula(zeta, 0.01)).norm(), kRoundOff1d);
}

// ---- the worked example (docs/tutorial.md): exact rationals

struct WorkedExample {
  World world;
  BodyId a, b;
  JointId line;

  explicit WorkedExample(const JointType& type) : world(make_options()) {
    Body body_a = make_body("a", Point{}, 2.0, {0.0, 0.0, 0.0});
    body_a.inertia = {1.0, 2.0, 4.0};
    body_a.state.angular_velocity = {0.0, 0.0, 1.0};
    Body body_b = make_body("b", Point{}, 4.0, {4.0, 0.0, 0.0});
    body_b.inertia = {2.0, 4.0, 8.0};
    body_b.state.linear_velocity = {1.0, 2.0, 0.0};
    body_b.state.angular_velocity = {0.0, 0.0, -1.0};
    a = world.add_body(body_a);
    b = world.add_body(body_b);
    line = world.add_joint(make_joint("line", a, {1.0, 0.5, 0.0}, b, {-1.0, 0.5, 0.0}, type));
  }

  static WorldOptions make_options() {
    WorldOptions options = weightless(0.01);
    options.iterations = 1;
    options.baumgarte = 0.1;
    return options;
  }

  double impulse() const { return world.joint_state(line).force * world.options().time_step; }
};

constexpr double kWorked = 1e-12;  // far above the rounding of two dozen operations, 1e-14

void expect_near(const Vector3d& is, const Vector3d& expected, double tolerance) {
  EXPECT_LE((is - expected).norm(), tolerance)
      << "is " << is.transpose() << ", expected " << expected.transpose();
}

TEST(WorkedExample, CDotAndConstraintMass) {
  WorkedExample example(DistanceJoint{});
  EXPECT_NEAR(distance(example.world, example.line), 2.0, kWorked);
  EXPECT_NEAR(example.world.joint_state(example.line).reached_rate, 2.0, kWorked);  // J V
  example.world.step();
  EXPECT_NEAR(-2.0 / example.impulse(), 27.0 / 32.0, kWorked);
}

TEST(WorkedExample, WithoutBias) {
  WorkedExample example(DistanceJoint{});  // present length: C = 0, so Baumgarte adds nothing
  example.world.step();
  EXPECT_NEAR(example.impulse(), -64.0 / 27.0, kWorked);
  const BodyState& a = example.world.state(example.a);
  const BodyState& b = example.world.state(example.b);
  expect_near(a.linear_velocity, {32.0 / 27.0, 0.0, 0.0}, kWorked);
  expect_near(b.linear_velocity, {11.0 / 27.0, 2.0, 0.0}, kWorked);
  expect_near(a.angular_velocity, {0.0, 0.0, 19.0 / 27.0}, kWorked);
  expect_near(b.angular_velocity, {0.0, 0.0, -23.0 / 27.0}, kWorked);
}

TEST(WorkedExample, WithBaumgarte) {
  WorkedExample example(rod(1.5));
  example.world.step();
  EXPECT_NEAR(example.impulse(), -224.0 / 27.0, kWorked);
  const BodyState& a = example.world.state(example.a);
  const BodyState& b = example.world.state(example.b);
  expect_near(a.linear_velocity, {112.0 / 27.0, 0.0, 0.0}, kWorked);
  expect_near(b.linear_velocity, {-29.0 / 27.0, 2.0, 0.0}, kWorked);
  expect_near(a.angular_velocity, {0.0, 0.0, -1.0 / 27.0}, kWorked);
  expect_near(b.angular_velocity, {0.0, 0.0, -13.0 / 27.0}, kWorked);
}

// One sweep solves a single row, so more sweeps, and the previous step's impulse, keep the row's
// target: J V = 0.
TEST(WorkedExample, RowIsMetAfterEverySweepAndStep) {
  WorkedExample example(DistanceJoint{});
  example.world.step();
  const World::Anchors before = example.world.anchors(example.line);
  const Vector3d n = (before.p_b - before.p_a).normalized();
  const BodyState a = example.world.state(example.a);
  const BodyState b = example.world.state(example.b);
  example.world.step();
  const BodyState& a_1 = example.world.state(example.a);
  const BodyState& b_1 = example.world.state(example.b);
  // linear momentum along the rod is only exchanged
  EXPECT_NEAR(2.0 * n.dot(a_1.linear_velocity - a.linear_velocity),
              -4.0 * n.dot(b_1.linear_velocity - b.linear_velocity), kWorked);
  // the impulse satisfies the row: (ζ − β/h C − J V)/(J M⁻¹ Jᵀ)
  const auto arm = [&](const Vector3d& p, const BodyState& body) { return p - body.position; };
  const auto turned = [](const BodyState& body, const Vector3d& inertia, const Vector3d& x) {
    const Vector3d x_B = body.orientation.conjugate() * x;
    return Vector3d(body.orientation * x_B.cwiseQuotient(inertia));
  };
  const Vector3d j2 = -arm(before.p_a, a).cross(n);
  const Vector3d j4 = arm(before.p_b, b).cross(n);
  const double mass = 1.0 / 2.0 + j2.dot(turned(a, {1.0, 2.0, 4.0}, j2)) + 1.0 / 4.0 +
                      j4.dot(turned(b, {2.0, 4.0, 8.0}, j4));
  const double J_V = n.dot(b.linear_velocity - a.linear_velocity) + j2.dot(a.angular_velocity) +
                     j4.dot(b.angular_velocity);
  const double C = (before.p_b - before.p_a).norm() - 2.0;
  EXPECT_NEAR(example.impulse(), (-0.1 / 0.01 * C - J_V) / mass, kWorked);
}

// ---- the experiment: pull the bodies apart and watch the error

/// Two boxes joined by a rod of 2 m between the faces towards each other, pulled apart by 1 m.
struct PulledApart {
  World world;
  JointId joint;

  PulledApart(double world_beta, std::optional<double> joint_beta) : world(weightless(0.01)) {
    WorldOptions options = world.options();
    options.baumgarte = world_beta;
    world.set_options(options);
    const Box cube{Vector3d::Ones()};
    const BodyId a = world.add_body(make_body("a", cube, 2.0, {0.0, 0.0, 0.0}));
    const BodyId b = world.add_body(make_body("b", cube, 3.0, {3.0, 0.0, 0.0}));
    Joint rod = make_joint("rod", a, {0.5, 0.0, 0.0}, b, {-0.5, 0.0, 0.0});
    rod.baumgarte = joint_beta;
    joint = world.add_joint(rod);
    BodyState state = world.state(b);
    state.position.x() += 1.0;
    world.set_state(b, state);
  }

  void expect_decay(double beta) {
    EXPECT_EQ(world.joint_state(joint).error, 1.0);
    double expected = 1.0;
    for (int step = 1; step <= 60; ++step) {
      world.step();
      expected *= 1.0 - beta;
      // each step rounds positions of up to 4 m a few times
      EXPECT_NEAR(world.joint_state(joint).error, expected, 16.0 * step * kEpsilon)
          << "β = " << beta << ", step " << step;
    }
  }
};

TEST(PullApart, ErrorFallsByBetaEachStep) {
  for (const double beta : {0.1, 0.25, 0.5, 1.0})
    PulledApart(beta, std::nullopt).expect_decay(beta);
}

TEST(PullApart, ErrorStaysWithoutBaumgarte) { PulledApart(0.0, std::nullopt).expect_decay(0.0); }

TEST(PullApart, JointsOwnBetaOverridesTheWorlds) {
  PulledApart(0.5, 0.1).expect_decay(0.1);
  PulledApart(0.5, 0.0).expect_decay(0.0);
  PulledApart(0.0, 0.2).expect_decay(0.2);
}

TEST(PullApart, JointSaysThatItIsClosingUntilOneHundredthIsLeft) {
  PulledApart pulled(0.5, std::nullopt);
  EXPECT_TRUE(pulled.world.joint_state(pulled.joint).closing);
  run(pulled.world, 6);  // 1/64 remains
  EXPECT_TRUE(pulled.world.joint_state(pulled.joint).closing);
  run(pulled.world, 1);
  EXPECT_FALSE(pulled.world.joint_state(pulled.joint).closing);
}

}  // namespace
}  // namespace constraint_sim::engine
