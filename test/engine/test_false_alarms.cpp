// Correct behaviour is not reported as an error: work of corrections, errors that a command is
// closing, and estimates of spinning bodies.

#include <cmath>

#include "support.h"

namespace constraint_sim::engine {
namespace {

// ---- energy

World pressed_ball(Method method, double time_step, double overlap) {
  WorldOptions options;
  options.method = method;
  options.time_step = time_step;
  options.gravity.setZero();
  World world(options);
  Body wall = make_body("wall", Box{{0.1, 4.0, 4.0}}, 0.0, {0.1, 0.0, 0.0});
  wall.type = BodyType::kStatic;
  world.add_body(wall);
  const BodyId ball =
      world.add_body(make_body("ball", Sphere{0.02}, 0.2, {0.03 + overlap, 0.0, 0.0}));
  Wrench wrench;
  wrench.body = ball;
  wrench.force = {800.0, 0.0, 0.0};
  world.add_wrench(wrench);
  return world;
}

// 800 N press a ball against a wall, from a distance and from an overlap that is closed meanwhile.
TEST(FalseAlarms, CorrectionsAgainstAWrenchGiveNoEnergy) {
  for (const Method method : {Method::kAuto, Method::kSequentialImpulses})
    for (const double time_step : {1.0 / 30, 1.0 / 60, 1.0 / 240, 1.0 / 1000})
      for (const double overlap : {-0.03, 0.002, 0.005}) {
        World world = pressed_ball(method, time_step, overlap);
        for (double t = 0.0; t < 0.5; t += time_step)
          ASSERT_EQ(world.step().energy.rise, 0.0)
              << name(method) << ' ' << time_step << ' ' << overlap << ' ' << world.time();
      }
}

// The wrench loses the work of the corrections against it.
TEST(FalseAlarms, CorrectionsDoTheWorkThatAWrenchLoses) {
  World world = pressed_ball(Method::kSequentialImpulses, 0.01, 0.005);
  double driven = 0.0, corrections = 0.0;
  const double start = world.state(world.find_body("ball")).position.x();
  for (int i = 0; i < 100; ++i) {
    const StepReport& report = world.step();
    driven += report.energy.driven_work;
    corrections += report.energy.correction_work;
  }
  const double moved = world.state(world.find_body("ball")).position.x() - start;
  EXPECT_LT(moved, -0.004);
  EXPECT_NEAR(driven, 800.0 * moved, 1e-9);
  EXPECT_NEAR(corrections, -800.0 * moved, 1e-9);
}

// ---- commands

/// An arm of 1 kg and 0.5 m on a hinge about y, held level by a motor.
World motorized_arm(Method method, double max_force) {
  WorldOptions options;
  options.method = method;
  World world(options);
  const BodyId bar =
      world.add_body(make_body("arm", Box{{0.5, 0.05, 0.05}}, 1.0, {0.25, 0.0, 0.0}));
  Joint joint = make_joint("hinge", kWorldBody, {0, 0, 0}, bar, {-0.25, 0, 0}, JointKind::kHinge);
  joint.frame_a = frame_along(Eigen::Vector3d::UnitY());
  joint.coordinates[0].motor.emplace();
  joint.coordinates[0].motor->position = 0.0;
  joint.coordinates[0].motor->max_force = max_force;
  world.add_joint(joint);
  return world;
}

void send(World* world, double position) {
  const JointId hinge = world->find_joint("hinge");
  Motor motor = *world->joint(hinge).coordinates[0].motor;
  motor.position = position;
  world->set_motor(hinge, 0, motor);
}

// 2.45 N m hold the arm; 20 N m suffice for the motion too.
TEST(FalseAlarms, AMotorOnItsWayIsReportedApart) {
  for (const Method method : {Method::kAuto, Method::kEnergyMomentum})
    for (const double max_force : {0.0, 20.0}) {
      World world = motorized_arm(method, max_force);
      for (int i = 0; i < 10; ++i) world.step();
      send(&world, -0.4);
      double largest = 0.0;
      for (int i = 0; i < 100; ++i) {
        const StepReport& report = world.step();
        ASSERT_LE(report.joints.max_error, 1e-9) << name(method) << max_force << " step " << i;
        ASSERT_EQ(report.joints.unclosed, 0u);
        if (report.joints.closing_error > 0.0) {
          ASSERT_EQ(report.joints.worst_closing, world.find_joint("hinge"));
        }
        largest = std::max(largest, report.joints.closing_error);
      }
      const JointState& state = world.joint_state(world.find_joint("hinge"));
      EXPECT_NEAR(state.coordinates[0].position, -0.4, 1e-6) << name(method) << max_force;
      // the path of 0.4 rad at the radius of gyration, less the first tick
      EXPECT_GT(largest, 0.9 * 0.4 * state.radius);
      EXPECT_LE(world.report().joints.closing_error, 1e-6);
    }
}

// A motor that cannot lift the arm is saturated; the hinge holds nevertheless.
TEST(FalseAlarms, AMotorWithoutTheForceIsNoUnclosedJoint) {
  World world = motorized_arm(Method::kAuto, 1.0);
  for (int i = 0; i < 300; ++i) {
    const StepReport& report = world.step();
    ASSERT_LE(report.joints.max_error, 1e-9) << i;
    ASSERT_EQ(report.joints.unclosed, 0u) << i;
  }
  const JointState& state = world.joint_state(world.find_joint("hinge"));
  EXPECT_GT(std::abs(state.coordinates[0].position), 0.1);
}

// An error that nothing closes is still reported, beside a motor on its way.
TEST(FalseAlarms, AnErrorThatNothingClosesIsNone) {
  WorldOptions options;
  World world(options);
  const BodyId bob = world.add_body(make_body("bob", Point{}, 1.0, {0.0, 0.0, -1.1}));
  world.add_joint(hang("short", bob, rod(1.0)));
  world.add_joint(hang("long", bob, rod(1.2)));
  for (int i = 0; i < 100; ++i) world.step();
  EXPECT_EQ(world.report().joints.unclosed, 2u);
  EXPECT_NEAR(world.report().joints.max_error, 0.1, 0.01);
}

// ---- estimates

// A wheel on a hinge at constant speed: its angle is known, whatever the angle per tick. A substep
// turns it by half a radian at most.
TEST(FalseAlarms, EstimateOfASpinningWheelIsItsError) {
  const double radius = 0.1;
  for (const int order : {2, 4})
    for (const double speed : {10.0, 100.0, 300.0, 1000.0}) {
      WorldOptions options;
      options.method = Method::kEnergyMomentum;
      options.stiff_order = order;
      options.time_step = 1.0 / 60;
      options.gravity.setZero();
      World world(options);
      Body wheel = make_body("wheel", Cylinder{radius, 0.02}, 1.0, {0.0, 0.0, 0.0});
      wheel.state.angular_velocity.z() = speed;
      const BodyId id = world.add_body(wheel);
      world.add_joint(make_joint("hinge", kWorldBody, {0, 0, 0}, id, {0, 0, 0}, JointKind::kHinge));
      double estimate = 0.0;
      for (int i = 0; i < 60; ++i) estimate += world.step().local_error;
      const JointState& state = world.joint_state(world.find_joint("hinge"));
      const double gyration = radius / std::sqrt(2.0);
      const double error = gyration * std::abs(state.coordinates[0].position - speed);
      // leading order of the angle; half of it in the first tick
      EXPECT_NEAR(estimate, error, 0.1 * error) << order << ' ' << speed;
    }
}

}  // namespace
}  // namespace constraint_sim::engine
