// Steps that end early: by the stop flag, by a time without a next tick, by exceptions of the
// system.

#include <atomic>
#include <chrono>
#include <ctime>
#include <stdexcept>
#include <thread>

#include "engine/support/workers.h"
#include "problems.h"
#include "support.h"

namespace constraint_sim::engine {
namespace {

using Eigen::Vector3d;

/// A box on the floor, a pendulum, a stiff spring and a tumbling box: an island of each kind.
World one_of_each(int iterations) {
  WorldOptions options;
  options.time_step = 0.01;
  options.iterations = iterations;
  World world(options);
  world.add_body(make_floor(0.5));
  world.add_body(make_body("block", Box{{0.2, 0.2, 0.2}}, 1.0, {0.0, 0.0, 0.0999}));
  const BodyId bob = world.add_body(make_body("bob", Point{}, 1.0, {11.0, 0.0, 5.0}));
  world.add_joint(make_joint("rod", kWorldBody, {10.0, 0.0, 5.0}, bob, Vector3d::Zero()));
  const BodyId load = world.add_body(make_body("load", Point{}, 1.0, {21.0, 0.0, 5.0}));
  DistanceJoint spring;
  spring.length = 1.0;
  spring.stiffness = 1e9;
  world.add_joint(
      make_joint("spring", kWorldBody, {20.0, 0.0, 5.0}, load, Vector3d::Zero(), spring));
  Body tumbling = make_body("tumbling", Box{{0.1, 0.2, 0.3}}, 1.0, {30.0, 0.0, 50.0});
  tumbling.state.angular_velocity = {1.0, 2.0, 3.0};
  world.add_body(tumbling);
  return world;
}

TEST(Stop, AStepThatNeverEndsIsEndedByTheFlagAndTheStateIsThatOfBefore) {
  World world = one_of_each(10000);
  DistanceJoint rope;
  rope.max_length = 0.5;
  for (int i = 0; i < 50000; ++i)
    world.add_joint(make_joint("rope_" + std::to_string(i), kWorldBody, {30.0, 0.0, 49.0},
                               world.find_body("tumbling"), Vector3d::Zero(), rope));
  const std::uint64_t hash = world.state_hash();
  std::atomic<bool> stop{false};
  world.set_stop_flag(&stop);
  std::thread other([&] {
    std::this_thread::sleep_for(std::chrono::milliseconds(50));
    stop = true;
  });
  const std::clock_t start = std::clock();  // processor time: others may be busy
  const StepReport report = world.step();
  const double passed = static_cast<double>(std::clock() - start) / CLOCKS_PER_SEC;
  other.join();
  EXPECT_TRUE(report.outcome.stopped);
  EXPECT_FALSE(report.outcome.failed);
  EXPECT_EQ(report.step, 0u);
  EXPECT_EQ(world.state_hash(), hash);
  EXPECT_LT(passed, 5.0);  // 10000 sweeps over 50000 rows take ten
}

/// Long thin poles that lie crosswise, square and round: the bounds of a fifth of all pairs
/// overlap, and the gap of each of these pairs is looked for.
World heap_of_poles(int count) {
  WorldOptions options;
  options.time_step = 0.01;
  World world(options);
  Random random;
  const Shape shapes[] = {Cylinder{0.01, 10.0}, Box{{0.02, 0.02, 10.0}}};
  for (int i = 0; i < count; ++i) {
    const Vector3d place = random.vector();
    Body pole = make_body("pole_" + std::to_string(i), shapes[i % 2], 1.0,
                          {10.0 * place.x(), 10.0 * place.y(), place.z()});
    pole.state.orientation = Eigen::AngleAxisd(kPi * random(), Vector3d::UnitZ()) *
                             Eigen::AngleAxisd(0.5 * kPi + 0.3 * random(), Vector3d::UnitY());
    world.add_body(pole);
  }
  return world;
}

std::atomic<bool> stop_from_first_stage_on{false};
double clock_that_stops() {
  stop_from_first_stage_on = true;
  return 0.0;
}

// The clock sets the flag where the broadphase begins. Gaps take more than nine tenths of a whole
// step, and a stopped step looks for none.
TEST(Stop, AStepOfAHeapOfLongPolesIsEndedWhileGapsAreLookedFor) {
  World whole = heap_of_poles(400), world = whole;
  const auto time_of_step = [](World* of) {
    const std::clock_t start = std::clock();
    of->step();
    return static_cast<double>(std::clock() - start);
  };
  const double time = time_of_step(&whole);
  EXPECT_FALSE(whole.report().outcome.stopped);
  const std::uint64_t hash = world.state_hash();
  world.set_clock(clock_that_stops);
  world.set_stop_flag(&stop_from_first_stage_on);
  const double stopped_after = time_of_step(&world);
  EXPECT_TRUE(world.report().outcome.stopped);
  EXPECT_EQ(world.state_hash(), hash);
  EXPECT_LT(stopped_after, 0.3 * time);
}

std::atomic<bool> stop_at_reading{false};
int readings_left = 0;
double clock_that_stops_later() {
  if (--readings_left == 0) stop_at_reading = true;
  return 0.0;
}

// A ball hits a floor that falls away, whose work on the ball is negative. A stopped step takes the
// work back with the motion, whichever stage the stop follows. Otherwise the next comparison of
// energies would find a rise.
TEST(Stop, TheWorkOfAStoppedStepIsNotCounted) {
  for (int reading = 1; reading <= 8; ++reading) {
    WorldOptions options;
    options.time_step = 0.01;
    World world(options);
    Body floor = make_body("floor", Box{{2.0, 2.0, 0.2}}, 0.0, {0.0, 0.0, -0.1});
    floor.type = BodyType::kKinematic;
    floor.state.linear_velocity = {0.0, 0.0, -0.5};
    world.add_body(floor);
    Body ball = make_body("ball", Sphere{0.1}, 1.0, {0.0, 0.0, 0.103});
    ball.restitution = 0.5;
    ball.state.linear_velocity = {0.0, 0.0, -1.5};
    world.add_body(ball);
    world.set_clock(clock_that_stops_later);
    world.set_stop_flag(&stop_at_reading);
    for (int i = 0; i < 4; ++i) {
      readings_left = reading;
      world.step();
      if (!stop_at_reading) break;  // a step reads the clock less often
      EXPECT_TRUE(world.report().outcome.stopped);
      EXPECT_EQ(world.time(), 0.0);
      stop_at_reading = false;
    }
    world.set_clock(nullptr);
    const StepReport hit = world.step();
    EXPECT_EQ(hit.costs.events, world.step_count() == 1 ? 1u : 0u) << reading;
    for (int i = 0; i < 40; ++i) ASSERT_EQ(world.step().energy.rise, 0.0) << reading << " " << i;
  }
}

TEST(Stop, AWorldThatWasStoppedGoesOn) {
  World world = one_of_each(10);
  run(world, 20);
  World other = world;
  std::atomic<bool> stop{true};
  world.set_stop_flag(&stop);
  EXPECT_TRUE(world.step().outcome.stopped);
  EXPECT_EQ(world.time(), other.time());
  for (const BodyId id : world.body_ids()) {
    EXPECT_EQ(world.state(id).position, other.state(id).position);
    EXPECT_EQ(world.state(id).linear_velocity, other.state(id).linear_velocity);
  }
  stop = false;
  run(world, 50);
  run(other, 50);
  EXPECT_FALSE(world.report().outcome.stopped);
  EXPECT_EQ(world.step_count(), other.step_count());
  // methods restart, so substeps differ: both are within the tolerance of 1e-8 m/s, and the block,
  // whose impulses are lost, within the fall of one tick, g h² = 1e-3 m
  for (const BodyId id : world.body_ids())
    EXPECT_LT((world.state(id).position - other.state(id).position).norm(),
              world.body(id).name == "block" ? 1e-3 : 1e-7)
        << world.body(id).name;
}

TEST(Stop, WithoutTheFlagSetNothingChanges) {
  World world = one_of_each(10), other = one_of_each(10);
  const std::atomic<bool> stop{false};
  world.set_stop_flag(&stop);
  run(world, 50);
  run(other, 50);
  EXPECT_EQ(world.state_hash(), other.state_hash());
}

TEST(Stop, ATimeWithoutANextTickIsRefused) {
  World world = one_of_each(10);
  const std::uint64_t hash = world.state_hash();
  EXPECT_THROW(world.set_time(1e15, 0), std::invalid_argument);  // the ulp of 1e15 s is 0.125 s
  EXPECT_EQ(world.state_hash(), hash);
  world.set_time(1e9, 0);  // 1.2e-7 s
  WorldOptions shorter = world.options();
  shorter.time_step = 1e-8;
  EXPECT_THROW(world.set_options(shorter), std::invalid_argument);
  World scene(shorter);
  EXPECT_THROW(scene.continue_from(world), std::invalid_argument);
  EXPECT_EQ(world.options().time_step, 0.01);
  EXPECT_FALSE(world.step().outcome.failed);
}

TEST(Stop, WhatATaskThrowsReachesTheCallerAndTheWorkersGoOn) {
  for (const int threads : {1, 3}) {
    Workers workers;
    EXPECT_THROW(workers.run(threads, 100,
                             [](std::size_t i) {
                               if (i == 40) throw std::runtime_error("forty");
                             }),
                 std::runtime_error);
    std::atomic<int> calls{0};
    workers.run(threads, 100, [&](std::size_t) { ++calls; });
    EXPECT_EQ(calls, 100);
  }
}

}  // namespace
}  // namespace constraint_sim::engine
