// Joints of turning bodies in contact by time_stepping: closed at the end of each step, and motions
// of second order.

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <string>

#include "constraint_sim/engine/scene.h"
#include "constraint_sim/engine/world.h"
#include "support.h"

namespace constraint_sim::engine {
namespace {

using Eigen::Vector3d;

constexpr double kSpeed = 2.0, kLength = 1.0;  // [m/s], [m]

enum class Tether { kRod, kRope, kHinge };

/// A body on a floor without friction that a joint keeps on a circle about `centre`.
World circling(Tether tether, double time_step, const Vector3d& centre = Vector3d::Zero()) {
  WorldOptions options;
  options.method = Method::kTimeStepping;
  options.time_step = time_step;
  World world(options);
  world.add_body(make_floor(0.0));
  Body body = make_body("body", Sphere{0.1}, 1.0, centre + Vector3d(kLength, 0.0, 0.1));
  if (tether == Tether::kHinge) body.shape = Box{{0.3, 0.2, 0.2}};
  body.friction = 0.0;
  body.state.linear_velocity = {0.0, kSpeed, 0.0};
  body.state.angular_velocity = {0.0, 0.0, kSpeed / kLength};
  const BodyId id = world.add_body(body);
  Joint joint;
  joint.name = "joint";
  joint.body_b = id;
  joint.anchor_a = centre + Vector3d(0.0, 0.0, 0.1);
  if (tether == Tether::kHinge) {
    joint.kind = JointKind::kHinge;
    joint.anchor_b = {-kLength, 0.0, 0.0};
    joint.axis_b = Vector3d::UnitZ();
  } else {
    joint.kind = JointKind::kDistance;
    if (tether == Tether::kRope)
      joint.distance.max_length = kLength;
    else
      joint.distance.length = kLength;
  }
  world.add_joint(joint);
  return world;
}

struct Errors {
  double angle, length, speed;  ///< [rad], [m], share
};

Errors errors_after(World world, double duration, const Vector3d& centre = Vector3d::Zero()) {
  Errors errors{0.0, 0.0, 0.0};
  const int steps = static_cast<int>(std::round(duration / world.options().time_step));
  for (int i = 0; i < steps; ++i) {
    const StepReport& report = world.step();
    errors.length = std::max(errors.length, report.joints.max_error);
    EXPECT_GT(report.costs.islands[static_cast<std::size_t>(Method::kTimeStepping)], 0u);
  }
  const BodyState& state = world.state(world.find_body("body"));
  const Vector3d r = state.position - centre;
  errors.angle = std::abs(
      std::remainder(std::atan2(r.y(), r.x()) - kSpeed / kLength * world.time(), 2.0 * M_PI));
  errors.speed = std::abs(state.linear_velocity.norm() / kSpeed - 1.0);
  return errors;
}

class JointCurvature : public testing::TestWithParam<Tether> {};

INSTANTIATE_TEST_SUITE_P(Tethers, JointCurvature,
                         testing::Values(Tether::kRod, Tether::kRope, Tether::kHinge));

TEST_P(JointCurvature, ClosesJointsAtTheEndOfEachStep) {
  // The solver ends at residuals of 5e-6 g h, which last for h; at 1 km rounding adds 1e-10 m.
  for (const double h : {0.1, 0.05, 0.02, 0.01, 0.001})
    for (const double distance : {0.0, 1000.0}) {
      const Vector3d centre(distance, 0.0, 0.0);
      EXPECT_LT(errors_after(circling(GetParam(), h, centre), 2.0, centre).length,
                5e-6 * 9.81 * h * h + 1e-10)
          << h << ' ' << distance;
    }
}

TEST_P(JointCurvature, MakesMotionsOfSecondOrder) {
  // The first step begins with a velocity along the circle and ends with one along its chord: both
  // angle and speed are off by a share of (ω h)² / 3 and of 3/8 (ω h)².
  const double h = 0.02, turn = kSpeed / kLength * h;
  const Errors coarse = errors_after(circling(GetParam(), h), 2.0);
  const Errors fine = errors_after(circling(GetParam(), 0.5 * h), 2.0);
  EXPECT_LT(coarse.angle, 0.4 * turn * turn * kSpeed / kLength * 2.0);
  EXPECT_LT(coarse.speed, 0.4 * turn * turn);
  EXPECT_NEAR(coarse.angle / fine.angle, 4.0, 0.3);
  EXPECT_NEAR(coarse.speed / fine.speed, 4.0, 0.3);
}

TEST(JointCurvature, MovesACartWithPolesAsByEvents) {
  // A double pendulum on a cart that slides without friction, against event-driven contacts.
  const auto world_by = [](Method method, double time_step) {
    WorldOptions options;
    options.method = method;
    options.time_step = time_step;
    World world(options);
    world.add_body(make_floor(0.0));
    Body cart = make_body("cart", Box{{0.6, 0.6, 0.2}}, 3.0, {0.0, 0.0, 0.1});
    cart.friction = 0.0;
    BodyId below = world.add_body(cart);
    double half = 0.1, height = 0.2;
    for (const char* name : {"pole", "tip"}) {
      Body bar = make_body(name, Box{{0.05, 0.05, 1.0}}, 1.0, {0.0, 0.0, height + 0.5});
      bar.no_collision = true;
      bar.state.angular_velocity = {0.0, 1.5, 0.0};
      bar.state.linear_velocity = {1.5 * (height + 0.5 - 0.2), 0.0, 0.0};
      const BodyId id = world.add_body(bar);
      Joint joint;
      joint.name = name;
      joint.kind = JointKind::kBall;
      joint.body_a = below;
      joint.body_b = id;
      joint.anchor_a = {0.0, 0.0, half};
      joint.anchor_b = {0.0, 0.0, -0.5};
      world.add_joint(joint);
      below = id;
      half = 0.5;
      height += 1.0;
    }
    return world;
  };
  const auto tip_after = [](World world, double duration) {
    run(world, static_cast<int>(std::round(duration / world.options().time_step)));
    EXPECT_LT(world.report().joints.max_error, 1e-6);
    return world.state(world.find_body("tip")).position;
  };
  const Vector3d exact = tip_after(world_by(Method::kEventDriven, 0.01), 0.6);
  const double coarse = (tip_after(world_by(Method::kTimeStepping, 0.01), 0.6) - exact).norm();
  const double fine = (tip_after(world_by(Method::kTimeStepping, 0.005), 0.6) - exact).norm();
  EXPECT_LT(coarse, 1e-2);
  EXPECT_LT(fine, 0.3 * coarse);  // second order, with a smaller term of the first
}

TEST(JointCurvature, IsLeftOutWhereCorrectionsDoNotConverge) {
  // A net of rods between fixed bodies cannot give way under a ball that falls on it: corrections
  // by curvature grow with each repetition.
  for (const double baumgarte : {0.0, 0.1}) {
    WorldOptions options;
    options.method = Method::kTimeStepping;
    options.time_step = 0.03;
    World world(options);
    constexpr int kMeshes = 4;
    BodyId knots[kMeshes + 1][kMeshes + 1];
    const auto is_border = [](int i) { return i == 0 || i == kMeshes; };
    for (int i = 0; i <= kMeshes; ++i)
      for (int k = 0; k <= kMeshes; ++k) {
        Body knot = make_body("knot_" + std::to_string(i) + "_" + std::to_string(k), Sphere{0.1},
                              0.2, {1.0 * i, 1.0 * k, 2.0});
        if (is_border(i) || is_border(k)) knot.type = BodyType::kStatic;
        knots[i][k] = world.add_body(knot);
      }
    const auto add_rod = [&](BodyId a, BodyId b) {
      Joint rod;
      rod.name = "rod_" + std::to_string(world.joint_ids().size());
      rod.kind = JointKind::kDistance;
      rod.body_a = a;
      rod.body_b = b;
      rod.distance.length = 1.0;
      rod.baumgarte = baumgarte;
      world.add_joint(rod);
    };
    for (int i = 0; i <= kMeshes; ++i)
      for (int k = 0; k < kMeshes; ++k) {
        if (is_border(i)) continue;
        add_rod(knots[i][k], knots[i][k + 1]);
        add_rod(knots[k][i], knots[k + 1][i]);
      }
    Body ball = make_body("ball", Sphere{0.45}, 1.0, {2.3, 2.2, 2.56});
    ball.friction = 0.3;
    ball.state.linear_velocity = {0.0, 0.0, -3.0};
    world.add_body(ball);
    double worst = 0.0;
    for (int i = 0; i < 13; ++i) worst = std::max(worst, world.step().joints.max_error);
    EXPECT_LT(worst, 1e-3) << baumgarte;  // errors alone leave 6e-4 m
  }
}

TEST(JointCurvature, IsLeftOutInANetThatHangsAtItsCorners) {
  // Ten by ten knots under a load of half their mass: corrections by curvature become infinite.
  constexpr int kKnots = 10;
  std::string bodies = "bodies:\n", joints = "constraints:\n";
  const auto name_of = [](int i, int k) {
    return "k" + std::to_string(i) + "_" + std::to_string(k);
  };
  const auto add_rod = [&](const std::string& a, const std::string& b) {
    joints += "- {type: distance, name: " + a + b + ", body_a: " + a + ", body_b: " + b +
              ", length: 0.1}\n";
  };
  for (int i = 0; i < kKnots; ++i)
    for (int k = 0; k < kKnots; ++k) {
      const bool is_middle = i == kKnots / 2 && k == kKnots / 2;
      const std::string at =
          "[" + std::to_string(0.1 * i) + ", " + std::to_string(0.1 * k) + ", 1]";
      bodies +=
          "- {mass: 0.1, friction: 0.5, shape: {sphere: {radius: 0.02}}, name: " + name_of(i, k) +
          ", position: " + at + ", no_collision: " + (is_middle ? "false" : "true") + "}\n";
      if (i + 1 < kKnots) add_rod(name_of(i, k), name_of(i + 1, k));
      if (k + 1 < kKnots) add_rod(name_of(i, k), name_of(i, k + 1));
      if (i % (kKnots - 1) == 0 && k % (kKnots - 1) == 0)
        joints += "- {type: ball, name: at_" + name_of(i, k) + ", body_b: " + name_of(i, k) +
                  ", anchor_a: " + at + "}\n";
    }
  bodies +=
      "- {name: load, mass: 5, friction: 0.5, shape: {sphere: {radius: 0.3}}, "
      "position: [0.5, 0.5, 1.35]}\n";
  World world = load_scene("world: {time_step: 0.01, method: time_stepping}\n" + bodies + joints);
  for (int i = 0; i < 20; ++i) {
    const StepReport& report = world.step();
    ASSERT_FALSE(report.outcome.failed) << i;
    ASSERT_LT(report.joints.max_error, 0.01) << i;  // errors alone leave 3e-3 m
    ASSERT_LT(std::abs(report.energy.correction_work), 1.0) << i;
  }
}

TEST(JointCurvature, LeavesNoResidualOfCorrectionsThatItDrops) {
  // Speeds about the limit of 0.5 rad in a step: without errors at the start nothing but curvature
  // is corrected.
  for (int i = 0; i <= 20; ++i) {
    World world = circling(Tether::kRod, 0.1);
    const BodyId body = world.find_body("body");
    BodyState state = world.state(body);
    state.linear_velocity.y() = 4.0 + 0.1 * i;
    world.set_state(body, state);
    for (int k = 0; k < 3; ++k) {
      EXPECT_LT(world.step().contacts.solver_residual, 1e-9) << i << " " << k;
      EXPECT_FALSE(world.report().contacts.unsolved_body) << i << " " << k;
    }
  }
}

}  // namespace
}  // namespace constraint_sim::engine
