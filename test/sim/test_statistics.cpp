#include <gtest/gtest.h>

#include "sim/statistics.h"

namespace constraint_sim {
namespace {

TEST(TickStatistics, KeepTheWorstAndTheSlowestOfAnInterval) {
  engine::World world;
  engine::WorldOptions options;
  options.method = engine::Method::kSequentialImpulses;  // error large enough to measure
  world.set_options(options);
  engine::Body bob;
  bob.name = "bob";
  bob.mass = 1.0;
  bob.state.position = {1.0, 0.0, 0.0};
  engine::Joint rod;
  rod.name = "rod";
  rod.body_b = world.add_body(bob);
  world.add_joint(rod);

  TickStatistics ticks;
  double worst = 0.0;
  for (const double seconds : {0.1, 0.3, 0.2}) {
    world.step();
    worst = std::max(worst, world.report().joints.max_error);
    ticks.add(world, seconds);
  }
  EXPECT_EQ(ticks.ticks, 3u);
  EXPECT_DOUBLE_EQ(ticks.simulated, 3.0 * options.time_step);
  EXPECT_EQ(ticks.worst_constraint, "rod");
  EXPECT_EQ(ticks.max_constraint_error, worst);
  EXPECT_GT(worst, 0.0);
  EXPECT_DOUBLE_EQ(ticks.wall_sum, 0.6);
  EXPECT_EQ(ticks.wall_max, 0.3);

  ticks.clear();
  EXPECT_EQ(ticks.ticks, 0u);
  EXPECT_EQ(ticks.worst_constraint, "");
}

}  // namespace
}  // namespace constraint_sim
