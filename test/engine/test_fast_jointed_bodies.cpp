// Fast bodies on joints against plates of a millimetre: no method lets a body pass through.
// Oracles: closed forms for events; else impossible results: a body on the other side, a rise of
// energy, an impact of a body that misses.

#include "constraint_sim/engine/plan.h"
#include "rotation_between.h"
#include "support.h"

namespace constraint_sim::engine {
namespace {

using Eigen::Vector3d;

constexpr double kSpeed = 500.0;
constexpr double kBobRadius = 0.05;
constexpr double kPlate = 1e-3;  // thickness [m]

void add_plate(World* world, const Vector3d& size, const Vector3d& position, double restitution) {
  Body plate = make_body("plate", Box{size}, 1.0, position);
  plate.type = BodyType::kStatic;
  plate.restitution = restitution;
  world->add_body(plate);
}

WorldOptions weightless_by(Method method, double time_step) {
  WorldOptions options = weightless(time_step);
  options.method = method;
  return options;
}

/// Adds a bob on a rod of 1 m about the origin, at the origin's height, moving down.
BodyId add_bob(World* world, const Shape& shape, double restitution) {
  Body bob = make_body("bob", shape, 1.0, {1.0, 0.0, 0.0});
  bob.state.linear_velocity.z() = -kSpeed;
  bob.restitution = restitution;
  const BodyId id = world->add_body(bob);
  world->add_joint(hang("rod", id));
  return id;
}

/// Adds two balls joined by a rod, one behind the other, moving along x.
std::vector<BodyId> add_joined_balls(World* world, double x, double z, double restitution,
                                     double break_force = 0.0) {
  std::vector<BodyId> ids;
  for (const double behind : {0.0, 0.3}) {
    Body ball = make_body("ball" + std::to_string(ids.size()), Sphere{kBobRadius}, 1.0,
                          {x - behind, 0.0, z});
    ball.state.linear_velocity.x() = kSpeed;
    ball.restitution = restitution;
    ids.push_back(world->add_body(ball));
  }
  Joint joint = make_joint("rod", ids[0], Vector3d::Zero(), ids[1], Vector3d::Zero());
  joint.break_force = break_force;
  world->add_joint(joint);
  return ids;
}

// The bob meets the plate where its circle does, and returns with e times the speed.
TEST(FastJointedBodies, EventsMeetAPlateAtItsPlace) {
  constexpr double kRestitution = 0.5;
  for (const Method method : {Method::kAuto, Method::kEventDriven}) {
    for (const double tick : {1.0 / 60, 1.0 / 240, 1.0 / 1000}) {
      World world(weightless_by(method, tick));
      add_plate(&world, {1.0, 2.0, kPlate}, {1.0, 0.0, -0.5}, kRestitution);
      const BodyId bob = add_bob(&world, Sphere{kBobRadius}, kRestitution);
      const double hit = std::asin(0.5 - 0.5 * kPlate - kBobRadius);
      while (world.time() < 0.016) {
        world.step();
        const double displacement = kSpeed * world.time() - hit;
        const double angle =
            displacement < 0.0 ? hit + displacement : hit - kRestitution * displacement;
        // a thousandth of the tolerance of 1e-6 m/s, at 500 rad/s
        EXPECT_LT(
            (world.state(bob).position - Vector3d(std::cos(angle), 0.0, -std::sin(angle))).norm(),
            1e-8)
            << name(method) << ' ' << tick << ' ' << world.time();
      }
    }
  }
}

// Impulses, requested or as the fallback for contacts: e = 0 leaves the bob on the plate.
TEST(FastJointedBodies, ABobStaysOnAPlateWhoeverCarriesIt) {
  const Shape shapes[] = {Sphere{kBobRadius}, Box{Vector3d::Constant(2.0 * kBobRadius)},
                          Cylinder{kBobRadius, 2.0 * kBobRadius},
                          Capsule{kBobRadius, 2.0 * kBobRadius}};
  for (const Shape& shape : shapes) {
    for (const Method method : {Method::kAuto, Method::kRungeKutta, Method::kSequentialImpulses}) {
      for (const double tick : {1.0 / 60, 1.0 / 240, 1.0 / 1000}) {
        World world(weightless_by(method, tick));
        add_plate(&world, {1.0, 2.0, kPlate}, {1.0, 0.0, -0.5}, 0.0);
        const BodyId bob = add_bob(&world, shape, 0.0);
        const double before = world.energy();
        while (world.time() < 0.05) {
          world.step();
          EXPECT_LE(world.energy(), (1.0 + 1e-9) * before) << name(method) << ' ' << tick;
          EXPECT_FALSE(world.report().contacts.hits_left_body) << name(method) << ' ' << tick;
        }
        EXPECT_GT(world.state(bob).position.z(), -0.5) << name(method) << ' ' << tick;
        EXPECT_GT(world.state(bob).position.x(), 0.5) << name(method) << ' ' << tick;
      }
    }
  }
}

TEST(FastJointedBodies, JoinedBallsStayOnTheirSideOfAWall) {
  for (const Method method : {Method::kAuto, Method::kRungeKutta, Method::kSequentialImpulses}) {
    for (const double e : {0.0, 0.5, 1.0}) {
      for (const double tick : {1.0 / 60, 1.0 / 240, 1.0 / 1000}) {
        World world(weightless_by(method, tick));
        add_plate(&world, {kPlate, 4.0, 4.0}, Vector3d::Zero(), e);
        const std::vector<BodyId> balls = add_joined_balls(&world, -1.0, 0.0, e);
        const double before = world.energy();
        while (world.time() < 0.05) {
          world.step();
          for (const BodyId ball : balls)
            EXPECT_LT(world.state(ball).position.x(), 0.0) << name(method) << e << ' ' << tick;
          EXPECT_LE(world.energy(), (1.0 + 1e-9) * before) << name(method) << e << ' ' << tick;
          EXPECT_FALSE(world.report().contacts.hits_left_body);
        }
      }
    }
  }
}

// A plate under its arm stops a bar that rotates by radians in a tick.
TEST(FastJointedBodies, ABarOnAHingeStopsAtAPlate) {
  for (const Method method : {Method::kAuto, Method::kRungeKutta, Method::kSequentialImpulses}) {
    for (const double tick : {1.0 / 60, 1.0 / 240, 1.0 / 1000}) {
      World world(weightless_by(method, tick));
      add_plate(&world, {0.5, 2.0, kPlate}, {0.9, 0.0, -0.4}, 0.0);
      Body bar = make_body("bar", Box{{2.0, 0.1, 0.1}}, 1.0, Vector3d::Zero());
      bar.state.angular_velocity.y() = kSpeed;
      const BodyId id = world.add_body(bar);
      Joint hinge;
      hinge.name = "hinge";
      hinge.kind = JointKind::kHinge;
      hinge.frame_a = rotation_between(Vector3d::UnitZ(), Vector3d::UnitY());
      hinge.body_b = id;
      world.add_joint(hinge);
      const double before = world.energy();
      while (world.time() < 0.05) {
        world.step();
        EXPECT_LE(world.energy(), (1.0 + 1e-9) * before) << name(method) << ' ' << tick;
        EXPECT_FALSE(world.report().contacts.hits_left_body) << name(method) << ' ' << tick;
      }
      const Vector3d arm = world.state(id).orientation * Vector3d::UnitX();
      EXPECT_GT(arm.x(), 0.8) << name(method) << ' ' << tick;
      EXPECT_GT(arm.z(), -0.5) << name(method) << ' ' << tick;
      EXPECT_LT(arm.z(), 0.1) << name(method) << ' ' << tick;
    }
  }
}

// A body that misses the plate by a centimetre hits nothing, and integrated islands stay
// integrated.
TEST(FastJointedBodies, AMissStaysAMiss) {
  for (const Method method : {Method::kAuto, Method::kRungeKutta, Method::kSequentialImpulses}) {
    for (const double tick : {1.0 / 240, 1.0 / 1000}) {
      World world(weightless_by(method, tick)), without(weightless_by(method, tick));
      add_plate(&world, {1.0, 2.0, kPlate}, {1.0 + kBobRadius + 0.01 + 0.5, 0.0, -0.1}, 1.0);
      const BodyId bob = add_bob(&world, Sphere{kBobRadius}, 1.0);
      const BodyId free = add_bob(&without, Sphere{kBobRadius}, 1.0);
      while (world.time() < 0.02) {
        world.step();
        without.step();
        EXPECT_TRUE(world.contacts().empty()) << name(method) << ' ' << tick;
        EXPECT_FALSE(world.report().contacts.hits_left_body) << name(method) << ' ' << tick;
        if (method == Method::kSequentialImpulses) continue;
        EXPECT_LT((world.state(bob).position - without.state(free).position).norm(), 1e-7)
            << name(method) << ' ' << tick;
        EXPECT_EQ(world.report().costs.islands[index_of(Method::kSequentialImpulses)], 0u);
      }
    }
  }
}

// The rod's impulse when the ball ahead stops counts in the mean of the tick, not of a part of the
// tick.
TEST(FastJointedBodies, ARodBreaksByTheMeanOfTheTick) {
  constexpr double kTick = 1.0 / 240;
  for (const double bears : {0.9, 1.1}) {
    World world(weightless_by(Method::kSequentialImpulses, kTick));
    add_plate(&world, {kPlate, 4.0, 4.0}, Vector3d::Zero(), 0.0);
    add_joined_balls(&world, -1.0, 0.0, 0.0, bears * kSpeed / kTick);
    const JointId rod = world.joint_ids().front();
    world.step();
    EXPECT_EQ(world.joint_state(rod).broken, bears < 1.0);
    // residual of the sweeps
    EXPECT_NEAR(std::abs(world.joint_state(rod).force), kSpeed / kTick, 0.01 * kSpeed / kTick);
  }
}

// A sleeping plate of a kilogram stops the balls and moves with them.
TEST(FastJointedBodies, WakeWhatTheyMayHit) {
  WorldOptions options = weightless_by(Method::kSequentialImpulses, 1.0 / 240);
  options.sleep_after = 0.01;
  World world(options);
  const BodyId plate =
      world.add_body(make_body("plate", Box{{kPlate, 4.0, 4.0}}, 1.0, Vector3d(20.0, 0.0, 0.0)));
  const std::vector<BodyId> balls = add_joined_balls(&world, 0.0, 0.0, 0.0);
  run(world, 8);
  EXPECT_EQ(world.report().costs.asleep, 1u);
  run(world, 8);
  EXPECT_EQ(world.report().costs.asleep, 0u);
  // all three kilograms move on together, within the sweeps' residual
  EXPECT_NEAR(world.state(plate).linear_velocity.x(), kSpeed * 2.0 / 3.0, 0.01 * kSpeed);
  EXPECT_GT(world.state(plate).position.x(), world.state(balls[0]).position.x());
}

// Balls that slide along a plate, nearer than a step can be divided.
TEST(FastJointedBodies, WhatIsLeftIsTold) {
  World world(weightless_by(Method::kSequentialImpulses, 1.0 / 60));
  add_plate(&world, {40.0, 4.0, kPlate}, {15.0, 0.0, 0.0}, 0.0);
  add_joined_balls(&world, 0.0, 0.5 * kPlate + kBobRadius + 1e-5, 0.0);
  world.step();
  ASSERT_EQ(faults_of(world).size(), 1u);
  EXPECT_EQ(
      with_advice(faults_of(world)[0]),
      "body 'ball0': it, or a body in contact with it, may pass through another body within a "
      "step: take a shorter time_step");
}

}  // namespace
}  // namespace constraint_sim::engine
