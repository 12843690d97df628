// Dynamics of robots with closed forms, of long trees, and of robots that are rejected.

#include <array>
#include <cmath>
#include <string>

#include "bars_on_hinges.h"
#include "constraint_sim/engine/robot_dynamics.h"
#include "displaced_robots.h"
#include "support.h"

namespace constraint_sim::engine {
namespace {

using Eigen::Index;
using Eigen::Matrix2d;
using Eigen::Matrix3d;
using Eigen::MatrixXd;
using Eigen::Quaterniond;
using Eigen::Vector2d;
using Eigen::Vector3d;
using Eigen::VectorXd;

// Closed forms of order 1 to 100: rounding.
constexpr double kRounding = 1e-12;

World empty_world() {
  WorldOptions options;
  options.gravity = {0.0, 0.0, -kGravity};
  options.method = Method::kRungeKutta;
  return World(options);
}

/// A body whose inertia is given, so that closed forms need no shape.
Body massive(const std::string& name, double mass, const Vector3d& inertia) {
  Body body = make_body(name, Box{{0.1, 0.1, 0.1}}, mass, Vector3d::Zero());
  body.inertia = inertia;
  body.no_collision = true;
  return body;
}

Joint joint_of(const std::string& name, JointKind kind, BodyId a, BodyId b, const Vector3d& axis) {
  Joint joint;
  joint.name = name;
  joint.kind = kind;
  joint.body_a = a;
  joint.body_b = b;
  joint.frame_a = frame_along(axis);
  return joint;
}

/// Sets pose and twist of a body that turns about the world's y axis.
void set_turned(World* world, BodyId id, double angle, double rate, const Vector3d& position,
                const Vector3d& velocity) {
  BodyState state;
  state.orientation = Quaterniond(Eigen::AngleAxisd(angle, Vector3d::UnitY()));
  state.angular_velocity = {0.0, rate, 0.0};
  state.position = position;
  state.linear_velocity = velocity;
  world->set_state(id, state);
}

// Two bars of 1 m that hang at angles a and a + b about y, with moments 0.3 and 0.2 kg m² about
// their middles (Spong, Hutchinson and Vidyasagar, Robot Modeling and Control, 2006, section 6.4).
TEST(RobotMechanisms, DoublePendulum) {
  const double m1 = 2.0, m2 = 3.0, I1 = 0.3, I2 = 0.2, a = 0.4, b = -1.1, da = 0.7, db = -1.9;
  World world = empty_world();
  const BodyId upper = world.add_body(massive("upper", m1, {I1, I1, 0.01}));
  Body hanging = massive("lower", m2, {I2, I2, 0.01});
  hanging.state.position = {0.0, 0.0, -1.0};
  const BodyId lower = world.add_body(hanging);
  Joint first = joint_of("first", JointKind::kHinge, kWorldBody, upper, Vector3d::UnitY());
  first.anchor_a = first.anchor_b = {0.0, 0.0, 0.5};
  Joint second = joint_of("second", JointKind::kHinge, upper, lower, Vector3d::UnitY());
  second.anchor_a = {0.0, 0.0, -0.5};
  second.anchor_b = {0.0, 0.0, 0.5};
  world.add_joint(first);
  world.add_joint(second);
  // A turn by a about y takes −z to (−sin a, 0, −cos a), which moves with ȧ (−cos a, 0, sin a).
  const auto down = [](double angle) { return Vector3d(-std::sin(angle), 0.0, -std::cos(angle)); };
  const auto moves = [](double angle) { return Vector3d(-std::cos(angle), 0.0, std::sin(angle)); };
  const Vector3d top(0.0, 0.0, 0.5);
  set_turned(&world, upper, a, da, top + 0.5 * down(a), 0.5 * da * moves(a));
  set_turned(&world, lower, a + b, da + db, top + down(a) + 0.5 * down(a + b),
             da * moves(a) + 0.5 * (da + db) * moves(a + b));

  const RobotDynamics robot = last_robot(world);
  EXPECT_LE((robot.position() - Vector2d(a, b)).norm(), kRounding);
  EXPECT_LE((robot.velocity() - Vector2d(da, db)).norm(), kRounding);
  Matrix2d M;
  M(1, 1) = 0.25 * m2 + I2;
  M(0, 1) = M(1, 0) = M(1, 1) + 0.5 * m2 * std::cos(b);
  M(0, 0) = 0.25 * m1 + I1 + m2 * (1.0 + 0.25 + std::cos(b)) + I2;
  EXPECT_LE((robot.mass_matrix() - M).norm(), kRounding);
  const double h = -0.5 * m2 * std::sin(b);
  const double g2 = 0.5 * m2 * kGravity * std::sin(a + b);
  const Vector2d g((0.5 * m1 + m2) * kGravity * std::sin(a) + g2, g2);
  const Vector2d coriolis(h * db * (2.0 * da + db), -h * da * da);
  EXPECT_LE((robot.gravity() - g).norm(), 10.0 * kRounding);
  EXPECT_LE((robot.bias() - g - coriolis).norm(), 10.0 * kRounding);
  EXPECT_EQ(robot.coordinates()[0].name, "first");
  EXPECT_EQ(robot.coordinates()[1].name, "second");
  EXPECT_EQ(robot.passive(), VectorXd::Zero(2));
}

// A cart of 2 kg on rails along x with a pole of 0.5 kg, whose centre is 0.6 m above its hinge,
// upright: the textbook's linear model.
TEST(RobotMechanisms, CartPoleUpright) {
  const double M = 2.0, m = 0.5, l = 0.6, I = 0.05;
  World world = empty_world();
  const BodyId cart = world.add_body(massive("cart", M, {0.1, 0.1, 0.1}));
  Body standing = massive("pole", m, {I, I, 0.01});
  standing.state.position = {0.0, 0.0, l};
  const BodyId pole = world.add_body(standing);
  world.add_joint(joint_of("rail", JointKind::kSlider, kWorldBody, cart, Vector3d::UnitX()));
  Joint hinge = joint_of("hinge", JointKind::kHinge, cart, pole, Vector3d::UnitY());
  hinge.anchor_b = {0.0, 0.0, -l};
  hinge.coordinates[0].damping = 0.3;
  world.add_joint(hinge);

  const RobotDynamics::Linearization by = last_robot(world).linearize(Vector2d::Zero());
  const double J = I + m * l * l, D = (M + m) * J - m * m * l * l;
  MatrixXd A = MatrixXd::Zero(4, 4), B = MatrixXd::Zero(4, 2);
  A(0, 2) = A(1, 3) = 1.0;
  A(2, 1) = -m * m * l * l * kGravity / D;
  A(3, 1) = (M + m) * m * l * kGravity / D;
  A(2, 3) = 0.3 * m * l / D;
  A(3, 3) = -0.3 * (M + m) / D;
  B(2, 0) = J / D;
  B(2, 1) = B(3, 0) = -m * l / D;
  B(3, 1) = (M + m) / D;
  EXPECT_LE((by.A - A).norm(), kRounding);
  EXPECT_LE((by.B - B).norm(), kRounding);
  EXPECT_LE(by.acceleration.norm(), kRounding);
}

// Euler's equations in axes of the body: I ω̇ = −ω × I ω + τ. A small rotation δ behind the pose R
// exp(∫ω) becomes −ω × δ: the rotation vector seen from axes that turn with ω.
TEST(RobotMechanisms, FreeBody) {
  World world = empty_world();
  const Vector3d I(0.2, 0.5, 0.6), w(1.3, -0.4, 0.8);
  Body body = massive("drone", 3.0, I);
  body.state.orientation = Random().orientation();
  body.state.angular_velocity = body.state.orientation * w;
  body.state.linear_velocity = {5.0, 6.0, 7.0};
  world.add_body(body);
  const RobotDynamics robot = last_robot(world);
  ASSERT_EQ(robot.size(), 6u);
  EXPECT_EQ(robot.coordinates()[1].name, "drone/linear_y");
  EXPECT_EQ(robot.coordinates()[5].name, "drone/angular_z");
  EXPECT_FALSE(robot.coordinates()[0].joint);
  VectorXd diagonal(6), velocity(6), bias(6);
  diagonal << 3.0, 3.0, 3.0, I;
  velocity << 5.0, 6.0, 7.0, w;
  bias << 0.0, 0.0, 3.0 * kGravity, w.cross(I.cwiseProduct(w));
  EXPECT_LE((robot.mass_matrix() - MatrixXd(diagonal.asDiagonal())).norm(), kRounding);
  EXPECT_LE((robot.velocity() - velocity).norm(), kRounding);
  EXPECT_LE((robot.bias() - bias).norm(), kRounding);

  const RobotDynamics::Linearization by = robot.linearize(robot.bias());
  const auto cross = [](const Vector3d& v) {
    Matrix3d m;
    m << 0.0, -v.z(), v.y(), v.z(), 0.0, -v.x(), -v.y(), v.x(), 0.0;
    return m;
  };
  MatrixXd A = MatrixXd::Zero(12, 12);
  A.topRightCorner(6, 6).setIdentity();
  A.block<3, 3>(3, 3) = -cross(w);
  A.block<3, 3>(9, 9) = I.cwiseInverse().asDiagonal() *
                        (cross(I.cwiseProduct(w)) - cross(w) * Matrix3d(I.asDiagonal()));
  EXPECT_LE((by.A - A).norm(), 10.0 * kRounding);
}

// A screw of 0.5 m per turn, and a gear with q₁ + 2 q₂ constant: one coordinate each.
TEST(RobotMechanisms, ScrewsAndGears) {
  World world = empty_world();
  const BodyId nut = world.add_body(massive("nut", 3.0, {0.2, 0.2, 0.4}));
  Joint screw = joint_of("screw", JointKind::kScrew, kWorldBody, nut, Vector3d::UnitZ());
  screw.pitch = 0.5;
  world.add_joint(screw);
  const RobotDynamics of_nut = last_robot(world);
  ASSERT_EQ(of_nut.size(), 1u);
  const double lead = 0.5 / (2.0 * kPi);  // m/rad
  EXPECT_EQ(of_nut.coordinates()[0].name, "screw/0");
  EXPECT_NEAR(of_nut.mass_matrix()(0, 0), 3.0 + 0.4 / (lead * lead), 1e-10);
  EXPECT_NEAR(of_nut.gravity()[0], 3.0 * kGravity, kRounding);
  ASSERT_EQ(of_nut.followers().size(), 1u);
  EXPECT_EQ(of_nut.followers()[0].coordinate, 1);
  EXPECT_NEAR(of_nut.followers()[0].ratio, 1.0 / lead, kRounding);

  std::array<BodyId, 2> wheels{};
  std::array<JointId, 2> axles{};
  for (std::size_t i = 0; i < 2; ++i) {
    Body wheel = massive("wheel_" + std::to_string(i), 1.0, {0.1, 0.1, i == 0 ? 0.7 : 0.3});
    wheel.state.position = {1.0 + static_cast<double>(i), 0.0, 0.0};
    wheels[i] = world.add_body(wheel);
    Joint axle = joint_of("axle_" + std::to_string(i), JointKind::kHinge, kWorldBody, wheels[i],
                          Vector3d::UnitZ());
    axle.anchor_a = wheel.state.position;
    axle.coordinates[0].stiffness = 4.0;
    axle.coordinates[0].rest = 0.5;
    axles[i] = world.add_joint(axle);
  }
  EXPECT_EQ(last_robot(world).size(), 1u);
  EXPECT_EQ(last_robot(world).bodies().size(), 1u);
  Joint gear;
  gear.name = "gear";
  gear.kind = JointKind::kGear;
  gear.coupling = {axles[0], axles[1], 2.0, {}};
  world.add_joint(gear);
  for (const BodyId wheel : wheels) {
    const RobotDynamics robot(world, wheel);
    ASSERT_EQ(robot.size(), 1u);
    EXPECT_EQ(robot.bodies().size(), 2u);
    EXPECT_EQ(robot.coordinates()[0].name, "axle_0");
    EXPECT_NEAR(robot.mass_matrix()(0, 0), 0.7 + 0.3 / 4.0, kRounding);
    EXPECT_NEAR(robot.passive()[0], 4.0 * 0.5 - 0.5 * 4.0 * 0.5, kRounding);
    ASSERT_EQ(robot.followers().size(), 1u);
    EXPECT_EQ(robot.followers()[0].joint, axles[1]);
    EXPECT_EQ(robot.followers()[0].leader, 0u);
    EXPECT_NEAR(robot.followers()[0].ratio, -0.5, kRounding);
    EXPECT_NEAR(robot.linearize(VectorXd::Zero(1)).A(1, 0), -(4.0 + 4.0 / 4.0) / 0.775, 1e-11);
  }
}

// Motors are part of τ: robots with and without them are the same.
TEST(RobotMechanisms, MotorsAreLeftOut) {
  WorldOptions options;
  World free = bars_on_hinges(options, {1.0, 2.0, 3.0}, 0.7, 0.1), driven = free;
  Motor turning, servo, pushing;
  turning.bias = 0.0;
  servo.position = 0.3;
  servo.servo_frequency = 2.0;
  pushing.force = 5.0;
  const std::vector<JointId> ids = driven.joint_ids();
  driven.set_motor(ids[0], 0, turning);
  driven.set_motor(ids[1], 0, servo);
  driven.set_motor(ids[2], 0, pushing);
  const RobotDynamics one = last_robot(free), other = last_robot(driven);
  EXPECT_EQ(one.mass_matrix(), other.mass_matrix());
  EXPECT_EQ(one.bias(), other.bias());
  EXPECT_EQ(one.passive(), other.passive());
}

// A chain beyond the trees that are integrated in joint coordinates, of hinges and of ball joints:
// forward dynamics are what a step does. Over h = 1e-5 s the mean acceleration of bodies is off by
// h/2 times its rate, of order 1e3.
TEST(RobotMechanisms, LongChains) {
  for (const bool has_balls : {false, true}) {
    WorldOptions options;
    options.method = Method::kRungeKutta;
    options.tolerance = 1e-12;
    options.time_step = 1e-5;
    World world = bars_on_hinges(options, std::vector<double>(60, 1.0), 0.1, 0.0);
    if (has_balls) {
      World balls(options);
      BodyId before = kWorldBody;
      for (const BodyId id : world.body_ids()) {
        Body body = world.body(id);
        const BodyId added = balls.add_body(body);
        Joint ball;
        ball.name = "ball_" + body.name;
        ball.kind = JointKind::kBall;
        ball.body_a = before;
        if (before != kWorldBody) ball.anchor_a = {0.05, 0.0, 0.0};
        ball.body_b = added;
        ball.anchor_b = {-0.05, 0.0, 0.0};
        balls.add_joint(ball);
        before = added;
      }
      world = balls;
    }
    const RobotDynamics robot = last_robot(world);
    EXPECT_EQ(robot.size(), has_balls ? 180u : 60u);
    const VectorXd qdd = robot.forward_dynamics(VectorXd::Zero(static_cast<Index>(robot.size())));
    World stepped = world;
    ASSERT_FALSE(stepped.step().outcome.failed);
    for (const BodyId id : robot.bodies()) {
      const auto motion = robot.motion_of(id);
      const VectorXd a = motion.J * qdd + motion.bias;
      const Vector3d mean =
          (stepped.state(id).linear_velocity - world.state(id).linear_velocity) / 1e-5;
      EXPECT_LE((a.head<3>() - mean).norm(), 1e-5);
    }
  }
}

// ---- rejected

std::string why_not(const World& world, BodyId body) {
  return refusal([&] { RobotDynamics(world, body); });
}

TEST(RobotMechanisms, SaysWhyThereIsNone) {
  World world = bars_on_hinges(WorldOptions{}, {1.0, 1.0, 1.0});
  const std::vector<BodyId> bars = world.body_ids();
  EXPECT_EQ(why_not(world, kWorldBody), "body: must be a dynamic body of the robot, got 'world'");
  EXPECT_EQ(why_not(world, BodyId{77}), "body: there is none with id 77");
  Joint rod;
  rod.name = "rod";
  rod.body_a = bars[0];
  rod.body_b = bars[2];
  const JointId rod_id = world.add_joint(rod);
  EXPECT_NE(why_not(world, bars[1]).find("'rod' (distance) acts between two points"),
            std::string::npos);
  world.set_broken(rod_id, true);
  EXPECT_EQ(why_not(world, bars[1]), "");

  Joint loop = joint_of("loop", JointKind::kBall, kWorldBody, bars[2], Vector3d::UnitZ());
  loop.anchor_a = {3.0, 0.0, 0.0};
  loop.anchor_b = {0.5, 0.0, 0.0};
  const JointId loop_id = world.add_joint(loop);
  EXPECT_EQ(
      why_not(world, bars[0]),
      "body: constraint 'loop' (ball) closes a loop between 'world' and 'bar_2'; the joints of "
      "a robot must form a tree");
  world.set_enabled(loop_id, false);
  EXPECT_EQ(why_not(world, bars[0]), "");

  BodyState off = world.state(bars[2]);
  off.position.z() += 0.01;
  world.set_state(bars[2], off);
  EXPECT_NE(why_not(world, bars[0]).find("'hinge_2' is still open by 0.0"), std::string::npos)
      << why_not(world, bars[0]);
}

// Limbs on one static body are robots of their own, or one robot; a joint that holds nothing makes
// them no other.
TEST(RobotMechanisms, SeveralTrees) {
  World world = bars_on_hinges(WorldOptions{}, {1.0, 2.0});
  const BodyId arm = world.body_ids().back();
  const BodyId wheel = world.add_body(massive("wheel", 1.0, {0.1, 0.1, 0.7}));
  world.add_joint(joint_of("axle", JointKind::kHinge, kWorldBody, wheel, Vector3d::UnitZ()));
  Joint idle;
  idle.name = "idle";
  idle.kind = JointKind::kFreeDistance;
  idle.body_a = arm;
  idle.body_b = wheel;
  const JointId measured = world.add_joint(idle);
  EXPECT_EQ(RobotDynamics(world, wheel).size(), 1u);
  const RobotDynamics both(world, {kWorldBody, wheel, arm});
  ASSERT_EQ(both.size(), 3u);
  EXPECT_EQ(both.coordinates()[2].name, "axle");
  MatrixXd M = MatrixXd::Zero(3, 3);
  M.topLeftCorner(2, 2) = RobotDynamics(world, arm).mass_matrix();
  M(2, 2) = 0.7;
  EXPECT_LE((both.mass_matrix() - M).norm(), kRounding);
  CoordinateLaw spring;
  spring.stiffness = 1.0;
  world.set_law(measured, 0, spring);
  EXPECT_NE(refusal([&] { RobotDynamics(world, wheel); }).find("'idle' (free_distance) acts"),
            std::string::npos);
  world.remove_joint(measured);
  const BodyId drone = world.add_body(massive("drone", 1.0, {0.1, 0.1, 0.7}));
  EXPECT_EQ(
      refusal([&] {
        RobotDynamics(world, {wheel, drone});
      }),
      "body: 'drone' is part of a tree that hangs on nothing, beside other trees of the robot");
  EXPECT_EQ(refusal([&] { RobotDynamics(world, std::vector<BodyId>{}); }),
            "body: must name a body of the robot, got none");
}

TEST(RobotMechanisms, SaysWhyItIsNoTree) {
  World world = empty_world();
  Body point = make_body("point", Point{}, 1.0, {1.0, 0.0, 0.0});
  EXPECT_EQ(why_not(world, world.add_body(point)).substr(0, 27), "body: 'point' is a point ma");
  const BodyId welded = world.add_body(massive("welded", 1.0, {1.0, 1.0, 1.0}));
  world.add_joint(joint_of("weld", JointKind::kWeld, kWorldBody, welded, Vector3d::UnitZ()));
  EXPECT_EQ(why_not(world, welded), "body: no joint of the robot leaves a coordinate free");
  const BodyId ball = world.add_body(massive("ball", 1.0, {1.0, 1.0, 1.0}));
  world.add_joint(joint_of("centre", JointKind::kBall, kWorldBody, ball, Vector3d::UnitZ()));
  EXPECT_NE(why_not(world, ball).find("'ball' is a point mass, or is held at its centre"),
            std::string::npos);
  const BodyId bead = world.add_body(massive("bead", 1.0, {1.0, 1.0, 1.0}));
  world.add_joint(joint_of("wire", JointKind::kPointOnLine, bead, kWorldBody, Vector3d::UnitZ()));
  EXPECT_NE(why_not(world, bead).find("'wire' (point_on_line) has its body A farther"),
            std::string::npos);
}

TEST(RobotMechanisms, ChecksItsArguments) {
  const World world = bars_on_hinges(WorldOptions{}, {1.0, 1.0});
  const RobotDynamics robot = last_robot(world);
  EXPECT_EQ(refusal([&] { robot.inverse_dynamics(VectorXd::Zero(3)); }),
            "acceleration: must have 2 numbers, one per coordinate, got 3");
  EXPECT_NE(refusal([&] { robot.forward_dynamics(Vector2d(0.0, kNaN)); }).find("force[1]: must be"),
            std::string::npos);
  EXPECT_NE(refusal([&] { robot.linearize(VectorXd()); }).find("got 0"), std::string::npos);
  EXPECT_EQ(refusal([&] { robot.motion_of(kWorldBody); }),
            "body: must be a body of the robot of 'bar_0', got id 0");
  EXPECT_NE(refusal([&] {
              robot.motion_of(world.body_ids()[0], {kNaN, 0.0, 0.0});
            }).find("point"),
            std::string::npos);
}

}  // namespace
}  // namespace constraint_sim::engine
