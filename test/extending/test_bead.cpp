// The shape that scripts/try_extending adds: a ball.

#include "bouncing.h"
#include "constraint_sim/engine/scene.h"
#include "support.h"

namespace constraint_sim::engine {
namespace {

using Eigen::Vector3d;

constexpr double kBeadRadius = 0.25;

// A fall from 1 m onto a floor, and bounces with half of the speed: heights in closed form at each
// step of event-driven contacts.
TEST(Bead, BouncesAndRestsAtItsRadius) {
  constexpr double kFall = 1.0, kRestitution = 0.5;
  WorldOptions chosen = options(1.0 / 100.0);
  chosen.method = Method::kEventDriven;
  World world(chosen);
  world.add_body(make_floor(0.5));
  Body bead = make_body("bead", Bead{kBeadRadius}, 2.0, {0.0, 0.0, kBeadRadius + kFall});
  bead.restitution = kRestitution;
  const BodyId id = world.add_body(bead);
  for (int i = 0; i < 300; ++i) {
    ASSERT_FALSE(world.step().outcome.failed);
    expect_bouncing(world.state(id).position.z() - kBeadRadius, kFall, kRestitution, world.time());
  }
  EXPECT_EQ(world.state(id).linear_velocity.norm(), 0.0);
}

// On each bounded shape by impulses: the overlap approaches the fall of one step to 1e-9 m.
TEST(Bead, RestsOnEachShape) {
  const std::vector<Shape> shapes{Sphere{0.5},
                                  Box{{1.0, 1.0, 1.0}},
                                  Cylinder{0.5, 1.0},
                                  Capsule{0.5, 1.0},
                                  Bead{0.5},
                                  Hull({{-0.5, -0.5, -0.5},
                                        {0.5, -0.5, -0.5},
                                        {-0.5, 0.5, -0.5},
                                        {0.5, 0.5, -0.5},
                                        {-0.5, -0.5, 0.5},
                                        {0.5, -0.5, 0.5},
                                        {-0.5, 0.5, 0.5},
                                        {0.5, 0.5, 0.5}})};
  for (const Shape& shape : shapes) {
    World world(options(1.0 / 100.0));
    Body base = make_body("base", shape, 0.0, Vector3d::Zero());
    base.type = BodyType::kStatic;
    world.add_body(base);
    const double top = std::holds_alternative<Capsule>(shape) ? 1.0 : 0.5;
    const BodyId id =
        world.add_body(make_body("bead", Bead{kBeadRadius}, 2.0, {0.0, 0.0, top + 0.5}));
    run(world, 200);
    EXPECT_NEAR(world.state(id).position.z(), top + kBeadRadius, slop(world) + 1e-9)
        << shape.index();
  }
}

TEST(Bead, HasTheMomentsOfABall) {
  EXPECT_EQ(unit_inertia(Bead{0.5}), unit_inertia(Sphere{0.5}));
  EXPECT_EQ(volume(Bead{0.5}), volume(Sphere{0.5}));
}

TEST(Bead, IsReadAndSavedByScenes) {
  const std::string saved =
      save_scene(load_scene("bodies: [{name: a, mass: 1, shape: {bead: {radius: 0.1}}}]\n"));
  EXPECT_NE(saved.find("bead"), std::string::npos) << saved;
  EXPECT_EQ(save_scene(load_scene(saved)), saved);
}

}  // namespace
}  // namespace constraint_sim::engine
