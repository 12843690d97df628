// Bodies that are convex hulls: they move as boxes of their size, are saved, and come to rest.

#include "constraint_sim/engine/scene.h"
#include "constraint_sim/engine/snapshot.h"
#include "support.h"

namespace constraint_sim::engine {
namespace {

std::vector<Eigen::Vector3d> corners(const Eigen::Vector3d& size) {
  std::vector<Eigen::Vector3d> list;
  for (unsigned i = 0; i < 8; ++i)
    list.push_back(0.5 * size.cwiseProduct(Eigen::Vector3d((i & 1u) != 0 ? 1.0 : -1.0,
                                                           (i & 2u) != 0 ? 1.0 : -1.0,
                                                           (i & 4u) != 0 ? 1.0 : -1.0)));
  return list;
}

World world_with(const Shape& shape, Method method) {
  WorldOptions options;
  options.method = method;
  World world(options);
  Body floor = make_body("floor", Plane{}, 0.0, {0, 0, 0});
  floor.type = BodyType::kStatic;
  floor.friction = 0.5;
  world.add_body(floor);
  Body body = make_body("body", shape, 2.0, {0, 0, 0.5});
  body.friction = 0.5;
  body.state.angular_velocity = {1.0, -0.7, 0.4};
  world.add_body(body);
  return world;
}

// A box and its hull have the same vertices in the same order against a plane.
TEST(Hulls, ACubeTumblesAsABox) {
  for (const Method method : {Method::kSequentialImpulses, Method::kTimeStepping}) {
    World box = world_with(Box{{0.2, 0.3, 0.1}}, method);
    World hull = world_with(Hull(corners({0.2, 0.3, 0.1})), method);
    const BodyId id = box.find_body("body");
    // sweeps of time_stepping end at a residual of 1e-3 of what a step changes, in the order of the
    // corners
    const double tolerance = method == Method::kTimeStepping ? 1e-6 : 1e-9;
    for (int i = 0; i < 600; ++i) {
      ASSERT_FALSE(box.step().outcome.failed);
      ASSERT_FALSE(hull.step().outcome.failed);
      ASSERT_LT((box.state(id).position - hull.state(id).position).norm(), tolerance) << i;
      ASSERT_LT(box.state(id).orientation.angularDistance(hull.state(id).orientation),
                100.0 * tolerance)
          << i;
    }
    EXPECT_LT(hull.state(id).linear_velocity.norm(), 1e-3);
    EXPECT_GT(hull.state(id).position.z(), 0.049);
  }
}

TEST(Hulls, AreSavedToTheBit) {
  Random random;
  std::vector<Eigen::Vector3d> points;
  for (int i = 0; i < 20; ++i)
    points.push_back(Eigen::Vector3d(0.3, 0.1, 0.0) + 0.2 * random.vector());
  World world = world_with(Hull(points), Method::kSequentialImpulses);
  run(world, 40);
  World loaded = load_scene(save_scene(world));
  EXPECT_EQ(read_snapshot(write_snapshot(world)).state_hash(), world.state_hash());
  EXPECT_EQ(loaded.state_hash(), world.state_hash());
  run(world, 40);
  run(loaded, 40);
  EXPECT_EQ(loaded.state_hash(), world.state_hash());
}

}  // namespace
}  // namespace constraint_sim::engine
