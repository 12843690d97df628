// Contacts by impulses have no estimate.

#include "support.h"

namespace constraint_sim::engine {
namespace {

using Eigen::Vector3d;

World cylinder_on_floor(double h, double tilt) {
  WorldOptions options;
  options.time_step = h;
  World world(options);
  Body floor = make_body("floor", Plane{}, 1.0, Vector3d::Zero());
  floor.type = BodyType::kStatic;
  floor.friction = 0.6;
  floor.state.orientation = Eigen::Quaterniond(Eigen::AngleAxisd(tilt, Vector3d::UnitY()));
  world.add_body(floor);
  Body cylinder = make_body("cylinder", Cylinder{0.1, 0.1}, 1.0,
                            floor.state.orientation * Vector3d(0.0, 0.0, 0.05));
  cylinder.state.orientation = floor.state.orientation;
  cylinder.friction = 0.6;
  world.add_body(cylinder);
  return world;
}

// What impulses advance has no estimate, in the report and of its island, and what they do not has
// one again.
TEST(ImpulseReports, HaveNoEstimate) {
  World world = cylinder_on_floor(1.0 / 60.0, 0.0);
  Body ball = make_body("ball", Sphere{0.1}, 1.0, {5.0, 0.0, 5.0});
  world.add_body(ball);
  world.step();
  EXPECT_TRUE(std::isnan(world.report().local_error));
  int unknown = 0;
  for (const Island& island : world.islands()) {
    EXPECT_EQ(std::isnan(island.local_error), island.method == Method::kSequentialImpulses);
    unknown += std::isnan(island.local_error) ? 1 : 0;
  }
  EXPECT_EQ(unknown, 1);
  world.remove_body(world.find_body("cylinder"));
  world.step();
  EXPECT_FALSE(std::isnan(world.report().local_error));
}

}  // namespace
}  // namespace constraint_sim::engine
