// Shapes off the centre of mass of their body.

#include "constraint_sim/engine/scene.h"
#include "support.h"

namespace constraint_sim::engine {
namespace {

using Eigen::Quaterniond;
using Eigen::Vector3d;

Quaterniond about_x(double angle) {
  return Quaterniond(Eigen::AngleAxisd(angle, Vector3d::UnitX()));
}

// A ball falls on a slope: a box with a pose in a static body, or the box's own body.
TEST(ShapePose, AShapeIsWhereItsBodyPutsIt) {
  std::vector<BodyState> ends;
  for (const bool has_pose : {false, true}) {
    World world(options(0.01));
    Body slope = make_body("slope", Box{{4.0, 4.0, 1.0}}, 0.0, {0.3, 0.1, -0.5});
    slope.type = BodyType::kStatic;
    slope.state.orientation = about_x(0.2);
    slope.friction = 0.4;
    if (has_pose) {
      const Quaterniond turn = about_x(-0.7);
      slope.state.position = {1.0, 2.0, 3.0};
      slope.state.orientation = turn;
      slope.shape_pose =
          ShapePose{turn.conjugate() * (Vector3d(0.3, 0.1, -0.5) - slope.state.position),
                    turn.conjugate() * about_x(0.2)};
    }
    world.add_body(slope);
    Body ball = make_body("ball", Sphere{0.2}, 1.0, {0.0, 0.0, 0.5});
    ball.friction = 0.4;
    const BodyId id = world.add_body(ball);
    run(world, 50);
    EXPECT_FALSE(world.contacts().empty());
    ends.push_back(world.state(id));
  }
  // rounding of the box's pose, which contacts amplify
  EXPECT_LT((ends[0].position - ends[1].position).norm(), 1e-10);
  EXPECT_LT((ends[0].angular_velocity - ends[1].angular_velocity).norm(), 1e-9);
}

// A ball whose centre of mass is d below its centre, on a frictionless plane: the centre of mass
// moves vertically only, and the ball rocks with ω² = m g d / I.
TEST(ShapePose, ABallWithItsMassBelowRocks) {
  const double m = 2.0, d = 0.05, inertia = 0.03, r = 0.2;
  const double period = 2.0 * kPi / std::sqrt(m * kGravity * d / inertia);
  for (const double h : {2e-3, 1e-3}) {
    World world(options(h));
    world.add_body(make_floor(0.0));
    Body ball = make_body("ball", Sphere{r}, m, {0.0, 0.0, r - d});
    ball.inertia = Vector3d::Constant(inertia);
    ball.shape_pose = ShapePose{{0.0, 0.0, d}, Quaterniond::Identity()};
    ball.state.orientation = about_x(0.05);
    ball.state.position.z() = r - d * std::cos(0.05);
    const BodyId id = world.add_body(ball);
    // the first time that it reverses on the other side
    double before = 0.0, time = 0.0;
    int turns = 0;
    while (turns < 2 && time < 3.0 * period) {
      world.step();
      time = world.time();
      const double w = world.state(id).angular_velocity.x();
      if (before * w < 0.0) ++turns;
      before = w;
    }
    // a tick of resolution, and for an amplitude θ the share θ²/16 = 1.6e-4
    EXPECT_NEAR(time, period, 1.5 * h + 2e-3 * period) << h;
  }
}

TEST(ShapePose, IsSavedHashedAndChecked) {
  World world;
  Body body = make_body("hammer", Box{{0.3, 0.1, 0.1}}, 2.0, Vector3d::Zero());
  body.inertia = {0.05, 0.06, 0.02};
  World without = world;
  without.add_body(body);
  body.shape_pose = ShapePose{{0.0, 0.0, 0.1}, about_x(0.3)};
  const BodyId id = world.add_body(body);
  EXPECT_NE(world.state_hash(), without.state_hash());
  const std::string text = save_scene(world);
  World loaded = load_scene(text);
  EXPECT_EQ(save_scene(loaded), text);
  EXPECT_EQ(loaded.state_hash(), world.state_hash());
  EXPECT_EQ(loaded.body(loaded.find_body("hammer")).shape_pose->position,
            world.body(id).shape_pose->position);

  body.name = "other";
  body.inertia.setZero();
  EXPECT_NE(refusal([&] { world.add_body(body); }).find("inertia"), std::string::npos);
  body.inertia = {0.05, 0.06, 0.02};
  body.shape_pose->position.x() = kNaN;
  EXPECT_NE(refusal([&] { world.add_body(body); }).find("position"), std::string::npos);
  body.shape_pose->position.x() = 0.0;
  body.shape_pose->orientation.coeffs() *= 2.0;
  EXPECT_NE(refusal([&] { world.add_body(body); }).find("orientation"), std::string::npos);
  body.shape_pose = ShapePose{};
  body.shape = Point{};
  EXPECT_NE(refusal([&] { world.add_body(body); }).find("shape_pose"), std::string::npos);
}

}  // namespace
}  // namespace constraint_sim::engine
