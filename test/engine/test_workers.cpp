// Islands advanced in parallel: the same bits with any number of threads.

#include <atomic>

#include "engine/support/workers.h"
#include "problems.h"
#include "support.h"

namespace constraint_sim::engine {
namespace {

using Eigen::Vector3d;

TEST(Workers, CallEachOnce) {
  Workers workers;
  for (const int threads : {1, 2, 4, 2, 1}) {
    for (const std::size_t count : {0, 1, 7, 1000}) {
      std::vector<std::atomic<int>> calls(count);
      workers.run(threads, count, [&](std::size_t i) { ++calls[i]; });
      for (const std::atomic<int>& of_one : calls) EXPECT_EQ(of_one, 1);
    }
  }
  Workers copy = workers;
  std::atomic<int> calls{0};
  copy.run(2, 100, [&](std::size_t) { ++calls; });
  EXPECT_EQ(calls, 100);
}

/// Smooth, stiff and contradictory islands, motors, rotating bodies and contacts, enough for
/// several threads.
World many_islands(int threads) {
  WorldOptions options;
  options.time_step = 0.02;
  options.threads = threads;
  World world(options);
  world.add_body(make_floor(0.5));
  for (int k = 0; k < 180; ++k) {
    const std::string name = std::to_string(k);
    const Vector3d at(0.0, 3.0 * k, 20.0);
    const BodyId a = world.add_body(make_body("a" + name, Point{}, 1.0, at + Vector3d(1, 0, 0)));
    const double load = k % 4 == 0 ? 1e6 : 1.0;
    const BodyId b =
        world.add_body(make_body("b" + name, Box{{0.2, 0.3, 0.4}}, load, at + Vector3d(2, 0, 0)));
    Joint top = make_joint("top" + name, kWorldBody, at, a, Vector3d::Zero());
    if (k % 3 == 0) {
      top.motor.amplitude = 0.3;
      top.motor.frequency = 0.5;
    }
    world.add_joint(top);
    world.add_joint(make_joint("low" + name, a, Vector3d::Zero(), b, {-0.1, 0.0, 0.0}));
    if (k % 7 == 0)  // contradicts the other two
      world.add_joint(make_joint("odd" + name, kWorldBody, at + Vector3d(9, 0, 0), a,
                                 Vector3d::Zero(), rod(3.0)));
    Body ball = make_body("ball" + name, Sphere{0.2}, 1.0, {5.0, 3.0 * k, 0.3 + 0.1 * k});
    ball.state.angular_velocity = {1.0, 2.0, 3.0};
    world.add_body(ball);
  }
  return world;
}

TEST(Threads, ChangeNotOneBit) {
  std::vector<World> worlds;
  for (const int threads : {1, 2, 4}) worlds.push_back(many_islands(threads));
  std::uint32_t changes = 0;
  for (int step = 0; step < 20; ++step) {
    for (World& world : worlds) world.step();
    const StepReport& one = worlds.front().report();
    changes += one.costs.method_changes;
    for (const World& world : worlds) {
      ASSERT_EQ(world.state_hash(), worlds.front().state_hash()) << step;
      ASSERT_EQ(world.report().energy.projected, one.energy.projected) << step;
      ASSERT_EQ(world.report().costs.method_changes, one.costs.method_changes) << step;
      ASSERT_EQ(world.report().costs.islands, one.costs.islands) << step;
      ASSERT_EQ(world.report().costs.substeps, one.costs.substeps) << step;
    }
    if (step == 10) worlds.back() = worlds.front();  // copies the world with a single thread
  }
  EXPECT_GT(changes, 20u);  // methods changed
  EXPECT_GT(worlds.front().report().costs.islands[index_of(Method::kEnergyMomentum)], 0u);
}

}  // namespace
}  // namespace constraint_sim::engine
