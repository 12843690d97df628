// A world that is reset equals a new one, bit for bit.

#include <functional>

#include "constraint_sim/engine/scene.h"
#include "engine/model/joint_data.h"
#include "support.h"

namespace constraint_sim::engine {
namespace {

using Eigen::Vector3d;

/// Boxes and balls that fall on a floor, with motors and breaking joints.
World world_to_reset() {
  World world(options(0.01));
  Body floor = make_floor(0.5);
  floor.restitution = 0.3;
  world.add_body(floor);
  Random random;
  std::vector<BodyId> boxes;
  for (int i = 0; i < 6; ++i) {
    boxes.push_back(world.add_body(make_tumbling_box(i, &random)));
  }
  // touches from the first step on, and when the world is reset
  Body resting = make_body("resting", Sphere{0.1}, 1.0, {-2.0, 0.0, 0.1 - 1e-4});
  resting.friction = 0.5;
  world.add_body(resting);
  const Vector3d corner(0.2, 0.15, 0.25);
  Joint driven = make_joint("driven", boxes[0], corner, boxes[2], -corner);
  driven.motor.bias = 0.2;
  driven.motor.amplitude = 0.1;
  driven.motor.frequency = 1.3;
  driven.motor.phase = 0.4;
  driven.motor.timeout = 0.77;
  world.add_joint(driven);
  Joint weak = make_joint("weak", kWorldBody, {0.0, 0.0, 3.0}, boxes[4], corner);
  weak.break_force = 5.0;
  world.add_joint(weak);
  world.add_joint(make_joint("ball", boxes[1], corner, boxes[3], -corner, JointKind::kBall));
  world.add_joint(make_joint("spring", boxes[4], corner, boxes[5], corner, spring(0.5, 50.0, 1.0)));
  world.add_joint(hang("torn", boxes[5], rope(0.1)), true);
  return world;
}

/// Changes all that can change at run time.
void disturb(World& world) {
  run(world, 60);
  Motor motor = world.joint(world.find_joint("driven")).motor;
  motor.bias = -0.3;
  motor.timeout = 0.5;
  world.set_motor(world.find_joint("driven"), motor);
  BodyState state = world.state(world.find_body("box_3"));
  state.position += Vector3d(0.3, 0.2, 0.1);
  state.linear_velocity.x() = 2.0;
  world.set_state(world.find_body("box_3"), state);
  world.set_broken(world.find_joint("ball"), true);
  world.set_broken(world.find_joint("torn"), false);
  world.add_wrench({world.find_body("box_0"), {10.0, 0.0, 5.0}, {0.1, 0.2, 0.3}});
  run(world, 37);
}

void expect_same_motion(World reset, World fresh) {
  reset.set_time(0.0, 0);
  EXPECT_EQ(reset.state_hash(), fresh.state_hash());
  std::uint32_t contacts = 0;
  for (int step = 0; step < 200; ++step) {
    contacts += reset.step().contacts.points;
    fresh.step();
    ASSERT_EQ(reset.state_hash(), fresh.state_hash()) << step;
  }
  EXPECT_GT(contacts, 100u);  // enough contacts for stale warm starting to show
}

TEST(Reset, GivesTheMotionOfANewWorld) {
  World world = world_to_reset();
  disturb(world);
  ASSERT_TRUE(world.joint_state(world.find_joint("weak")).broken);
  ASSERT_FALSE(world.contacts().empty());
  world.reset();
  expect_same_motion(world, world_to_reset());
  // a second time
  disturb(world);
  world.reset();
  expect_same_motion(world, world_to_reset());
}

TEST(Reset, AtOnceChangesNothing) {
  World world = world_to_reset();
  const std::uint64_t hash = world.state_hash();
  world.reset();
  EXPECT_EQ(world.state_hash(), hash);
}

TEST(Reset, GivesTheMotionOfALoadedScene) {
  const std::string text = save_scene(world_to_reset());
  World world = load_scene(text);
  disturb(world);
  world.reset();
  expect_same_motion(world, load_scene(text));
}

// Loading shifts the phases of motors, which a reset must undo.
TEST(Reset, GivesTheMotionOfASceneLoadedLater) {
  World before = world_to_reset();
  run(before, 123);
  World world = world_to_reset();
  world.continue_from(before);
  disturb(world);
  world.reset();
  expect_same_motion(world, world_to_reset());
}

TEST(Reset, LeavesTimeOptionsAndIdsAlone) {
  World world = world_to_reset();
  disturb(world);
  WorldOptions changed = world.options();
  changed.iterations = 7;
  world.set_options(changed);
  const double time = world.time();
  const std::uint64_t steps = world.step_count();
  const std::vector<BodyId> bodies = world.body_ids();
  const std::vector<JointId> joints = world.joint_ids();
  world.reset();
  EXPECT_EQ(world.time(), time);
  EXPECT_EQ(world.step_count(), steps);
  EXPECT_EQ(world.options().iterations, 7);
  EXPECT_EQ(world.body_ids(), bodies);
  EXPECT_EQ(world.joint_ids(), joints);
  EXPECT_TRUE(world.contacts().empty());
  EXPECT_TRUE(world.wrenches().empty());
}

TEST(Reset, CountsTimeoutsFromNow) {
  World world = world_to_reset();
  disturb(world);
  world.reset();
  EXPECT_EQ(world.joint_state(world.find_joint("driven")).expires_at, world.time() + 0.77);
  EXPECT_EQ(world.joint_state(world.find_joint("ball")).expires_at, kInfinity);
}

TEST(Reset, ReturnsTornJointsToWhatTheyWere) {
  World world = world_to_reset();
  disturb(world);
  world.reset();
  EXPECT_FALSE(world.joint_state(world.find_joint("weak")).broken);
  EXPECT_FALSE(world.joint_state(world.find_joint("ball")).broken);
  EXPECT_TRUE(world.joint_state(world.find_joint("torn")).broken);
}

// ---- with bodies and joints added and removed

void edit(World& world) {
  world.remove_body(world.find_body("box_1"));
  world.remove_joint(world.find_joint("spring"));
  Body late = make_body("late", Sphere{0.2}, 1.5, {0.5, 1.0, 2.0});
  late.friction = 0.2;
  late.state.linear_velocity = {0.1, 0.2, 0.3};
  const BodyId id = world.add_body(late);
  Joint joint = make_joint("late", kWorldBody, {0.5, 1.0, 3.0}, id, Vector3d::Zero(), rod(1.0));
  joint.motor.bias = 0.1;
  joint.motor.timeout = 0.3;
  world.add_joint(joint);
}

TEST(Reset, KeepsWhatWasAddedAndRemoved) {
  World world = world_to_reset();
  run(world, 50);
  edit(world);
  run(world, 50);
  world.reset();
  World fresh = world_to_reset();
  edit(fresh);
  expect_same_motion(world, fresh);
}

// A length determined when the joint was added stays, though the bodies return elsewhere.
TEST(Reset, KeepsTheLengthOfAJointAddedLater) {
  World world(options(0.01));
  const BodyId id = world.add_body(make_body("ball", Sphere{0.1}, 1.0, {0.0, 0.0, 1.0}));
  run(world, 50);
  const JointId joint =
      world.add_joint(make_joint("rod", kWorldBody, {0.0, 0.0, 5.0}, id, Vector3d::Zero()));
  const double length = distance(world, joint);
  ASSERT_GT(length, 5.0);
  Motor motor;
  motor.bias = 0.5;
  world.set_motor(joint, motor);
  run(world, 20);
  world.reset();
  EXPECT_EQ(world.joint(joint).distance.length, length);
  EXPECT_EQ(world.joint(joint).motor.bias, 0.0);
  const JointData& state = joint_data(world, joint);
  EXPECT_EQ(state.travel, 0.0);
  EXPECT_TRUE(state.impulse.isZero(0.0));
  EXPECT_EQ(state.initial_error, 4.0 - length);  // 4 m from the ball's start
  EXPECT_TRUE(state.closing);
}

TEST(Reset, EndsAFailure) {
  World world(options(0.01));
  const BodyId id = world.add_body(make_body("ball", Sphere{0.1}, 1.0, {0.0, 0.0, 1.0}));
  BodyState state = world.state(id);
  state.position.x() = state.linear_velocity.x() = kMostMagnitude;
  world.set_state(id, state);
  ASSERT_TRUE(world.step().outcome.failed);
  world.reset();
  EXPECT_FALSE(world.step().outcome.failed);
}

TEST(Reset, RestartsTheCountOfDrift) {
  World world(options(0.01));
  world.add_body(make_body("ball", Sphere{0.1}, 1.0, {0.0, 0.0, 1.0}));
  const double first = world.step().energy.drift;
  run(world, 20);
  world.reset();
  EXPECT_EQ(world.step().energy.drift, first);
}

}  // namespace
}  // namespace constraint_sim::engine
