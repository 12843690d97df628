#include <gtest/gtest.h>

#include <cmath>
#include <string>

#include "engine/math/numbers.h"
#include "sim/grip.h"

namespace constraint_sim {
namespace {

using engine::World;

using Eigen::Vector3d;

using engine::kPi;

engine::Body ball(const std::string& name, double mass, const Vector3d& position) {
  engine::Body body;
  body.name = name;
  body.shape = engine::Sphere{0.05};
  body.mass = mass;
  body.no_collision = true;
  body.state.position = position;
  return body;
}

World weightless() {
  engine::WorldOptions options;
  options.gravity.setZero();
  return World(options);
}

const engine::BodyState& state_of(const World& world, const std::string& name) {
  return world.state(world.find_body(name));
}

/// Drags like a mouse, in steps of 0.05 s: two metres along x in two seconds, then holds for two.
void drag_two_metres(World* world, const std::string& name) {
  const Vector3d start = state_of(*world, name).position;
  for (int update = 0; update < 80; ++update) {
    const double displacement = std::min(2.0, 0.05 * (update + 1));
    drag(world, name, start + displacement * Vector3d::UnitX());
    for (int tick = 0; tick < 5; ++tick) {
      world->step();
      ASSERT_FALSE(world->report().outcome.failed);
    }
  }
}

class GripOfMass : public ::testing::TestWithParam<double> {};

// x'' = -2 ω x' - ω² (x - X) from rest: X (1 - (1 + ω t) exp(-ω t)).
TEST_P(GripOfMass, FollowsAStepOfTheTargetCriticallyDamped) {
  World world = weightless();
  world.add_body(ball("a", GetParam(), Vector3d(1, 2, 3)));
  drag(&world, "a", Vector3d(1.1, 2, 3));
  const double omega = 2.0 * kPi * kGripFrequency;
  for (int tick = 0; tick < 50; ++tick) {
    world.step();
    const double phase = omega * world.time();
    const double expected = 0.1 * (1.0 - (1.0 + phase) * std::exp(-phase));
    // the springs are 1000 m long: directions are off by 0.1/1000, and their lengths by rounding
    EXPECT_NEAR(state_of(world, "a").position.x() - 1.0, expected, 1e-5) << world.time();
    EXPECT_NEAR(state_of(world, "a").position.y(), 2.0, 1e-5);
  }
}

TEST_P(GripOfMass, DragsTwoMetresAndLeavesNoEnergy) {
  World world = weightless();
  world.add_body(ball("a", GetParam(), Vector3d(1, 2, 3)));
  drag_two_metres(&world, "a");
  let_go(&world, "a");
  EXPECT_TRUE(world.joint_ids().empty());
  // 2 s at 12.6 rad/s are 25 time constants
  EXPECT_NEAR(state_of(world, "a").position.x(), 3.0, 1e-4);
  const double most = 0.5 * GetParam();  // energy of the drag, at 1 m/s [J]
  EXPECT_LT(world.energy(), 1e-6 * most);
}

INSTANTIATE_TEST_SUITE_P(Any, GripOfMass, ::testing::Values(1e-3, 1.0, 1e6));

TEST(Grip, HasALimitedForce) {
  World world = weightless();
  world.add_body(ball("a", 2.0, Vector3d::Zero()));
  drag(&world, "a", Vector3d(1000, 0, 0));
  world.step();
  const double acceleration = state_of(world, "a").linear_velocity.x() / world.time();
  EXPECT_GT(acceleration, 0.8 * kGripAcceleration);
  EXPECT_LE(acceleration, kGripAcceleration);
}

// Light beads carry a load of a billion times their mass: the dragged bead pulls it along.
class GripThroughChain : public ::testing::TestWithParam<std::pair<double, double>> {};

TEST_P(GripThroughChain, DragsWhatHangsOnIt) {
  const auto [bead, load] = GetParam();
  World world = weightless();
  for (int i = 0; i < 6; ++i)
    world.add_body(ball("b" + std::to_string(i), i == 0 ? load : bead, Vector3d(0.2 * i, 0, 0)));
  for (int i = 0; i < 5; ++i) {
    engine::Joint rod;
    rod.name = "rod" + std::to_string(i);
    rod.body_a = world.find_body("b" + std::to_string(i));
    rod.body_b = world.find_body("b" + std::to_string(i + 1));
    world.add_joint(rod);
  }
  drag_two_metres(&world, "b5");
  EXPECT_NEAR(state_of(world, "b5").position.x(), 3.0, 1e-2);
  EXPECT_NEAR(state_of(world, "b0").position.x(), 2.0, 1e-2);
  const double held = world.energy();
  let_go(&world, "b5");
  // releasing removes the springs' energy and adds none
  EXPECT_LE(world.energy(), held + 1e-9 * load);
  const double left = world.energy();
  EXPECT_LT(left, 1e-4 * 0.5 * (load + 5.0 * bead));  // over the energy of the drag, at 1 m/s
  for (int tick = 0; tick < 100; ++tick) world.step();
  EXPECT_LE(world.energy(), left + 1e-9 * load);
}

INSTANTIATE_TEST_SUITE_P(Any, GripThroughChain,
                         ::testing::Values(std::pair(1.0, 1.0), std::pair(1e-3, 1e6),
                                           std::pair(1e6, 1e-3)));

TEST(Grip, IsRefusedWhereNothingMoves) {
  World world;
  engine::Body wall = ball("wall", 1.0, Vector3d::Zero());
  wall.type = engine::BodyType::kStatic;
  world.add_body(wall);
  world.add_body(ball("a", 1.0, Vector3d(1, 0, 0)));
  const std::uint64_t hash = world.state_hash();
  EXPECT_THROW(drag(&world, "wall", Vector3d::Zero()), std::invalid_argument);
  EXPECT_THROW(drag(&world, "nobody", Vector3d::Zero()), std::invalid_argument);
  EXPECT_THROW(drag(&world, "a", Vector3d(NAN, 0, 0)), std::invalid_argument);
  let_go(&world, "a");
  EXPECT_EQ(world.state_hash(), hash);
}

TEST(Grip, CountsWhatJointsConnect) {
  World world;
  for (int i = 0; i < 3; ++i)
    world.add_body(ball(std::string(1, static_cast<char>('a' + i)), 1.0 + i, Vector3d(i, 0, 0)));
  engine::Joint rod;
  rod.name = "rod";
  rod.body_a = world.find_body("a");
  rod.body_b = world.find_body("c");
  world.add_joint(rod);
  EXPECT_EQ(mass_moved_with(world, world.find_body("a")), 4.0);
  EXPECT_EQ(mass_moved_with(world, world.find_body("b")), 2.0);
}

}  // namespace
}  // namespace constraint_sim
