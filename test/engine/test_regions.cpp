// Bodies in a box along the axes, against the extents of shapes along each axis in closed form.

#include "constraint_sim/engine/region.h"
#include "support.h"

namespace constraint_sim::engine {
namespace {

using Eigen::AngleAxisd;
using Eigen::Vector3d;

Body fixed_body(const std::string& name, const Shape& shape, const Vector3d& position) {
  Body body = make_body(name, shape, 1.0, position);
  body.type = BodyType::kStatic;
  return body;
}

TEST(Regions, HaveTheBodiesWhoseBoundsReachIn) {
  World world(weightless(0.01));
  const BodyId sphere = world.add_body(fixed_body("sphere", Sphere{0.5}, {3, 0, 0}));
  Body box = fixed_body("box", Box{{2, 2, 2}}, {0, 5, 0});
  box.state.orientation = AngleAxisd(0.25 * kPi, Vector3d::UnitZ());  // reaches to ±√2 along x, y
  const BodyId turned = world.add_body(box);
  Body ghost = fixed_body("ghost", Cylinder{0.25, 2.0}, {0, 0, 7});
  ghost.no_collision = true;
  ghost.shape_pose = ShapePose{{0, 0, 1}, Eigen::Quaterniond::Identity()};  // z from 7 to 9
  const BodyId beside = world.add_body(ghost);
  const BodyId point = world.add_body(fixed_body("point", Point{}, {-4, 0, 0}));
  const auto in = [&](const Vector3d& min, const Vector3d& max) {
    return bodies_in(world, min, max);
  };
  using Ids = std::vector<BodyId>;
  EXPECT_EQ(in({-9, -9, -9}, {9, 9, 9}), (Ids{sphere, turned, beside, point}));
  EXPECT_EQ(in({3.5, 0, 0}, {4, 1, 1}), Ids{sphere}) << "touching";
  EXPECT_EQ(in({3.5 + 1e-12, 0, 0}, {4, 1, 1}), Ids{});
  EXPECT_EQ(in({2.9, -0.1, -0.1}, {3.1, 0.1, 0.1}), Ids{sphere}) << "inside the sphere";
  EXPECT_EQ(in({1.41, 5, 0}, {2, 6, 1}), Ids{turned});
  EXPECT_EQ(in({1.42, 5, 0}, {2, 6, 1}), Ids{});
  EXPECT_EQ(in({0, 0, 6}, {0, 0, 6.999}), Ids{}) << "below the shape, not the body";
  EXPECT_EQ(in({0, 0, 8.9}, {0, 0, 10}), Ids{beside});
  EXPECT_EQ(in({-4, 0, 0}, {-4, 0, 0}), Ids{point}) << "a region of one point";
}

TEST(Regions, HavePlanesThatReachIn) {
  World world(weightless(0.01));
  Body plane = fixed_body("plane", Plane{}, {0, 0, 1});
  plane.state.orientation = AngleAxisd(0.25 * kPi, Vector3d::UnitY());  // normal (1, 0, 1)/√2
  const BodyId slope = world.add_body(plane);
  using Ids = std::vector<BodyId>;
  // solid where x + z <= 1
  EXPECT_EQ(bodies_in(world, {-1, 5, 1.9}, {3, 6, 4}), Ids{slope});
  EXPECT_EQ(bodies_in(world, {-1, 5, 2.1}, {3, 6, 4}), Ids{});
  EXPECT_EQ(bodies_in(world, {-9, 5, -9}, {-8, 6, -8}), Ids{slope}) << "far below";
}

TEST(Regions, AreCheckedByName) {
  const World world(weightless(0.01));
  EXPECT_EQ(refusal([&] {
              bodies_in(world, {0, kNaN, 0}, {1, 1, 1});
            }),
            "min: must be finite numbers, got (0, nan, 0)");
  EXPECT_EQ(refusal([&] {
              bodies_in(world, {0, 0, 0}, {1, 1, kInfinity});
            }),
            "max: must be finite numbers, got (1, 1, inf)");
  EXPECT_EQ(refusal([&] {
              bodies_in(world, {0, 2, 0}, {1, 1, 1});
            }),
            "max: must be at least min, (0, 2, 0), got (1, 1, 1)");
  EXPECT_TRUE(bodies_in(world, {-1, -1, -1}, {1, 1, 1}).empty());
}

}  // namespace
}  // namespace constraint_sim::engine
