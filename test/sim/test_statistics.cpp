#include <gtest/gtest.h>

#include "sim/statistics.h"

namespace constraint_sim {
namespace {

engine::World pendulum(engine::Method method) {
  engine::World world;
  engine::WorldOptions options;
  options.method = method;
  world.set_options(options);
  engine::Body bob;
  bob.name = "bob";
  bob.mass = 1.0;
  bob.state.position = {1.0, 0.0, 0.0};
  engine::Joint rod;
  rod.name = "rod";
  rod.body_b = world.add_body(bob);
  world.add_joint(rod);
  return world;
}

TEST(TickStatistics, KeepTheWorstAndTheSlowestOfAnInterval) {
  engine::World world =
      pendulum(engine::Method::kSequentialImpulses);  // error large enough to measure
  TickStatistics ticks;
  double worst = 0.0;
  for (const double seconds : {0.1, 0.3, 0.2}) {
    world.step();
    worst = std::max(worst, world.report().joints.max_error);
    ticks.add(world, seconds);
  }
  EXPECT_EQ(ticks.ticks, 3u);
  EXPECT_DOUBLE_EQ(ticks.simulated, 3.0 * world.options().time_step);
  EXPECT_EQ(ticks.worst_constraint, "rod");
  EXPECT_EQ(ticks.max_constraint_error, worst);
  EXPECT_GT(worst, 0.0);
  EXPECT_DOUBLE_EQ(ticks.wall_sum, 0.6);
  EXPECT_EQ(ticks.wall_max, 0.3);

  ticks.clear();
  EXPECT_EQ(ticks.ticks, 0u);
  EXPECT_EQ(ticks.worst_constraint, "");
}

TEST(TickStatistics, SumErrorsOfOneMotion) {
  engine::World world = pendulum(engine::Method::kRungeKutta);
  TickStatistics ticks;
  double sum = 0.0;
  const auto step = [&] {
    sum += world.step().local_error;
    ticks.add(world, 0.1);
    ticks.clear();
    EXPECT_EQ(ticks.accumulated_local_error, sum);
  };
  for (int i = 0; i < 3; ++i) step();
  EXPECT_GT(sum, 0.0);
  world.reset();
  world.set_time(0.0, 0);
  sum = 0.0;
  for (int i = 0; i < 3; ++i) step();
}

}  // namespace
}  // namespace constraint_sim
