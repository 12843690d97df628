// Motors and servos at their force limits beside contacts, advanced by impulses. Oracles: closed
// forms of motion under constant forces. Impulses are of first order: they reach or leave a limit
// up to a step late, which displaces a body by up to its speed times the step.

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <string>

#include "constraint_sim/engine/world.h"
#include "support.h"

namespace constraint_sim::engine {
namespace {

using Eigen::Vector3d;

constexpr double kForce = 30.0, kMass = 5.0, kFriction = 0.3;  // [N], [kg]

struct ByImpulses {
  Method method;
  double time_step;
};

class LimitsByImpulses : public testing::TestWithParam<ByImpulses> {
 protected:
  World make_world() const {
    WorldOptions options;
    options.method = GetParam().method;
    options.time_step = GetParam().time_step;
    options.iterations = 100;
    options.sleep_after = kInfinity;
    return World(options);
  }
  void run(World* world, double duration) const {
    for (int i = 0; i < std::round(duration / GetParam().time_step); ++i) world->step();
  }
};

BodyId add_box(World* world, double x, double friction) {
  Body floor = make_floor(friction);
  world->add_body(floor);
  Body box = make_body("box", Box{{0.6, 0.5, 0.4}}, kMass, {x, 0.0, 0.2});
  box.friction = friction;
  return world->add_body(box);
}

Joint to_world(BodyId body, const DistanceJoint& type, double rate) {
  Joint joint = make_joint("winch", kWorldBody, {0.0, 0.0, 0.2}, body, Vector3d::Zero(), type);
  joint.motor.bias = rate;
  joint.motor.max_force = kForce;
  return joint;
}

/// Distance that a box has moved after a time, which a force accelerates up to a speed.
double pulled(double force, double speed, double time) {
  const double a = force / kMass, there = std::min(time, speed / a);
  return 0.5 * a * there * there + speed * (time - there);
}

TEST_P(LimitsByImpulses, AWinchPullsABoxUpToItsSpeed) {
  constexpr double kSpeed = 0.8;
  World world = make_world();
  const BodyId box = add_box(&world, 5.0, kFriction);
  const JointId winch = world.add_joint(to_world(box, rope(5.0), -kSpeed));
  run(&world, 0.2);
  EXPECT_TRUE(world.joint_state(winch).saturated);
  EXPECT_NEAR(world.joint_state(winch).force, -kForce, 1e-6 * kForce);
  run(&world, 0.8);
  EXPECT_FALSE(world.joint_state(winch).saturated);
  const double moved = pulled(kForce - kFriction * kMass * kGravity, kSpeed, 1.0);
  EXPECT_NEAR(world.state(box).position.x(), 5.0 - moved, kSpeed * GetParam().time_step);
}

TEST_P(LimitsByImpulses, AStrutPushesABoxUpToItsSpeed) {
  constexpr double kSpeed = 0.8;
  World world = make_world();
  const BodyId box = add_box(&world, 2.0, kFriction);
  const JointId strut = world.add_joint(to_world(box, between(2.0, kInfinity), kSpeed));
  run(&world, 0.2);
  EXPECT_NEAR(world.joint_state(strut).force, kForce, 1e-6 * kForce);
  run(&world, 0.8);
  const double moved = pulled(kForce - kFriction * kMass * kGravity, kSpeed, 1.0);
  EXPECT_NEAR(world.state(box).position.x(), 2.0 + moved, kSpeed * GetParam().time_step);
}

// The rope slips while the box is faster than the winch, and has its new length afterwards.
TEST_P(LimitsByImpulses, ARopeSlipsWhereItsWinchIsTooWeak) {
  constexpr double kStart = 3.0;  // [m/s]
  World world = make_world();
  const BodyId box = add_box(&world, 5.0, 0.0);
  Joint joint = to_world(box, rope(5.0), 0.0);
  const JointId winch = world.add_joint(joint);
  BodyState state = world.state(box);
  state.linear_velocity.x() = kStart;
  world.set_state(box, state);
  run(&world, 0.2);
  EXPECT_NEAR(world.joint_state(winch).force, -kForce, 1e-6 * kForce);
  run(&world, 0.8);
  const double slipped = 0.5 * kStart * kStart / (kForce / kMass);
  EXPECT_NEAR(world.state(box).position.x(), 5.0 + slipped, kStart * GetParam().time_step);
  EXPECT_NEAR(world.state(box).linear_velocity.x(), 0.0, 1e-9);
}

// A spring that is wound has its natural length by the motor, also while its force is at the limit.
TEST_P(LimitsByImpulses, ASpringAtItsLimitIsWoundOn) {
  constexpr double kSpeed = 0.8, kTime = 0.2;
  World world = make_world();
  const BodyId box = add_box(&world, 5.0, 0.0);
  const JointId winch = world.add_joint(to_world(box, spring(5.0, 1e4, 0.0), -kSpeed));
  run(&world, kTime);
  const double moved = 0.5 * kForce / kMass * kTime * kTime;
  const double tolerance = kForce / kMass * kTime * GetParam().time_step;
  EXPECT_TRUE(world.joint_state(winch).saturated);
  EXPECT_NEAR(world.state(box).position.x(), 5.0 - moved, tolerance);
  EXPECT_NEAR(world.joint_state(winch).error, kSpeed * kTime - moved, tolerance);
}

// A spring of the same stiffness beside the servo has an energy of its own. The box swings about a
// point at which the spring and the force of the servo balance, with the spring's period.
TEST_P(LimitsByImpulses, AServoAtItsLimitTakesNoEnergyFromASpringOfEqualStiffness) {
  constexpr double kStiffness = 100.0, kStart = 0.5;  // [N/m], [m/s]
  World world = make_world();
  const BodyId box = add_box(&world, 5.0, 0.0);
  Joint joint =
      make_joint("servo", kWorldBody, {5.0, 0.0, 0.2}, box, Vector3d::Zero(), JointKind::kPlanar);
  CoordinateLaw& law = joint.coordinates[0];
  law.stiffness = kStiffness;
  law.motor.emplace();
  law.motor->position = 9.0;
  law.motor->servo_stiffness = kStiffness;
  law.motor->max_force = kForce;
  world.add_joint(joint);
  BodyState state = world.state(box);
  state.position.x() += kForce / kStiffness;  // where both balance
  state.linear_velocity.x() = kStart;
  world.set_state(box, state);
  const double omega = std::sqrt(kStiffness / kMass);
  const double quarter = std::round(0.25 * kPi / omega / GetParam().time_step);
  run(&world, quarter * GetParam().time_step);
  const double phase = omega * world.time();
  // implicit springs damp by ½ ω h per radian, and displace by a step
  const double tolerance = 1.5 * kStart * GetParam().time_step;
  EXPECT_NEAR(world.state(box).position.x(),
              5.0 + kForce / kStiffness + kStart / omega * std::sin(phase), tolerance);
}

// The box leaves the position of the servo by more than its force can hold, and comes back.
TEST_P(LimitsByImpulses, AServoAtItsLimitTakesNoEnergyFromOtherMotion) {
  constexpr double kStart = 2.0, kAcross = 1.5;  // [m/s]
  World world = make_world();
  const BodyId box = add_box(&world, 5.0, 0.0);
  Joint joint =
      make_joint("servo", kWorldBody, {0.0, 0.0, 0.2}, box, Vector3d::Zero(), JointKind::kPlanar);
  joint.coordinates[0].motor.emplace();
  joint.coordinates[0].motor->position = 3.0;
  joint.coordinates[0].motor->servo_stiffness = 1000.0;
  joint.coordinates[0].motor->servo_damping = 10.0;
  joint.coordinates[0].motor->max_force = kForce;
  const JointId servo = world.add_joint(joint);
  BodyState state = world.state(box);
  state.linear_velocity = {kStart, kAcross, 0.0};
  world.set_state(box, state);
  for (const double t : {0.2, 0.6}) {
    run(&world, t - world.time());
    const BodyState& now = world.state(box);
    const double tolerance = kForce / kMass * t * GetParam().time_step;
    EXPECT_TRUE(world.joint_state(servo).saturated);
    EXPECT_NEAR(now.linear_velocity.x(), kStart - kForce / kMass * t, 1e-6);
    EXPECT_NEAR(now.position.x(), 5.0 + kStart * t - 0.5 * kForce / kMass * t * t, tolerance);
    EXPECT_NEAR(now.linear_velocity.y(), kAcross, 1e-6);
    EXPECT_TRUE(world.warnings().empty());
  }
}

INSTANTIATE_TEST_SUITE_P(Steps, LimitsByImpulses,
                         testing::Values(ByImpulses{Method::kTimeStepping, 0.05},
                                         ByImpulses{Method::kTimeStepping, 0.01},
                                         ByImpulses{Method::kTimeStepping, 1e-3},
                                         ByImpulses{Method::kSequentialImpulses, 0.01},
                                         ByImpulses{Method::kSequentialImpulses, 1e-3}),
                         [](const auto& info) {
                           return std::string(name(info.param.method)) + "_" +
                                  std::to_string(
                                      static_cast<int>(std::lround(1.0 / info.param.time_step)));
                         });

}  // namespace
}  // namespace constraint_sim::engine
