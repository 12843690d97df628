// Capsules: contact points against spheres along the middle line, rolling and landing on a plane by
// events against closed forms, rest on other shapes, and saved bits. Their gaps are also compared
// with FCL (test/fcl).

#include "constraint_sim/engine/plan.h"
#include "constraint_sim/engine/scene.h"
#include "constraint_sim/engine/snapshot.h"
#include "engine/collision/narrowphase.h"
#include "support.h"

namespace constraint_sim::engine {
namespace {

using Eigen::AngleAxisd;
using Eigen::Quaterniond;
using Eigen::Vector3d;

const Quaterniond kLyingAlongY(AngleAxisd(-0.5 * kPi, Vector3d::UnitX()));

BodyState pose_at(const Vector3d& position,
                  const Quaterniond& orientation = Quaterniond::Identity()) {
  BodyState state;
  state.position = position;
  state.orientation = orientation;
  return state;
}

Shape random_other(int kind, Random* random) {
  const auto size = [&] { return 0.5 + 0.3 * (*random)(); };
  switch (kind) {
    case 0:
      return Sphere{0.5 * size()};
    case 1:
      return Box{{size(), size(), size()}};
    case 2:
      return Cylinder{0.5 * size(), size()};
    case 3:
      return Capsule{0.4 * size(), size()};
    default:
      std::vector<Vector3d> points;
      for (int i = 0; i < 12; ++i) points.push_back(0.4 * random->vector());
      return Hull(points);
  }
}

/// Returns the least gap of spheres along the middle line, by golden sections: the distance from a
/// convex shape is convex along a line.
double least_gap_of_spheres(const Capsule& capsule, const BodyState& a, const Shape& shape_b,
                            const BodyState& b) {
  const auto gap = [&](double s) {
    return separation(Sphere{capsule.radius},
                      pose_at(a.position + a.orientation * Vector3d(0.0, 0.0, s)), shape_b, b)
        .gap;
  };
  constexpr double kGolden = 0.6180339887498949;
  double low = -0.5 * capsule.length, high = -low;
  double p = high - kGolden * (high - low), q = low + kGolden * (high - low);
  double at_p = gap(p), at_q = gap(q);
  for (int i = 0; i < 60; ++i) {
    if (at_p < at_q) {
      high = q, q = p, at_q = at_p;
      at_p = gap(p = high - kGolden * (high - low));
    } else {
      low = p, p = q, at_p = at_q;
      at_q = gap(q = low + kGolden * (high - low));
    }
  }
  return std::min({gap(low), gap(-0.5 * capsule.length), gap(0.5 * capsule.length)});
}

TEST(CapsuleContacts, HaveTheGapOfTheNearestSphere) {
  Random random;
  int compared = 0;
  for (int i = 0; i < 2000 / kSanitizedShare; ++i) {
    const Capsule capsule{0.15 + 0.1 * random(), 0.5 + 0.3 * random()};
    const Shape other = random_other(i % 5, &random);
    const BodyState a = pose_at(0.8 * random.vector(), random.orientation());
    BodyState b = pose_at(0.2 * random.vector(), random.orientation());
    if (i % 2 == 0)  // axes that are parallel or at right angles
      b.orientation = a.orientation * AngleAxisd(0.5 * kPi * (i % 3), Vector3d::UnitX());
    const Separation found = separation(capsule, a, other, b);
    const Manifold contact = collide(capsule, a, other, b);
    ASSERT_EQ(contact.count > 0, found.gap < 0.0) << i;
    const double gap = least_gap_of_spheres(capsule, a, other, b);
    if (gap < -0.99 * capsule.radius) continue;  // the middle line may cross the shape
    ++compared;
    // The distance rises with the square of the place, which is found to 1e-8: rounding.
    ASSERT_NEAR(found.gap, gap, 1e-13) << i;
    for (int k = 0; k < contact.count; ++k) {
      const Manifold::Point& point = contact.points[static_cast<std::size_t>(k)];
      // No point is deeper than the shapes; normals of faces may differ by 2.56°.
      ASSERT_LT(point.depth, -found.gap + 0.05 * 0.8) << i;
      const Manifold other_order = collide(other, b, capsule, a);
      ASSERT_EQ(other_order.count, contact.count) << i;
      ASSERT_LT((other_order.normal + contact.normal).norm(), 1e-15) << i;
    }
  }
  EXPECT_GT(compared, 1000 / kSanitizedShare);
}

// A capsule that lies along y at the height of its radius less 0.01, on a shape whose top is at 0.
TEST(CapsuleContacts, LieOnTheirEnds) {
  const Capsule capsule{0.1, 0.6};
  const std::vector<Vector3d> roof{{-1, -1, -1}, {1, -1, -1},  {-1, 1, -1},
                                   {1, 1, -1},   {0, -0.2, 0}, {0, 0.2, 0}};
  struct Case {
    const char* name;
    Shape shape;
    BodyState state;
    int count;
    double width;  // along y, between the points
  };
  const Quaterniond level = Quaterniond::Identity();
  const Quaterniond skew(AngleAxisd(0.3, Vector3d::UnitZ()));
  const Case cases[] = {
      {"plane", Plane{}, pose_at({0, 0, 0}), 2, 0.6},
      {"wide box", Box{{2, 2, 1}}, pose_at({0, 0, -0.5}, skew), 2, 0.6},
      {"narrow box", Box{{0.2, 0.4, 1}}, pose_at({0, 0, -0.5}), 2, 0.4},
      {"edge of a box", Box{{0.2, 2, 0.2}},
       pose_at({0, 0, -0.1 * std::sqrt(2.0)},
               Quaterniond(AngleAxisd(0.25 * kPi, Vector3d::UnitY()))),
       2, 0.6},
      {"cap", Cylinder{0.2, 1}, pose_at({0, 0, -0.5}), 2, 0.4},
      {"side", Cylinder{0.2, 0.5}, pose_at({0, 0, -0.2}, kLyingAlongY), 2, 0.5},
      {"crossed side", Cylinder{0.2, 0.5}, pose_at({0, 0, -0.2}, skew * kLyingAlongY), 1, 0.0},
      {"capsule", Capsule{0.2, 0.4}, pose_at({0, 0.1, -0.2}, kLyingAlongY), 2, 0.4},
      {"crossed capsule", Capsule{0.2, 0.4}, pose_at({0, 0, -0.2}, skew * kLyingAlongY), 1, 0.0},
      {"ridge of a hull", Hull(roof), pose_at({0, 0, 0}, level), 2, 0.4},
      {"sphere", Sphere{0.5}, pose_at({0, 0, -0.5}), 1, 0.0},
  };
  for (const Case& c : cases) {
    const Manifold contact =
        collide(capsule, pose_at({0, 0, 0.09}, kLyingAlongY), c.shape, c.state);
    ASSERT_EQ(contact.count, c.count) << c.name;
    EXPECT_LT((contact.normal - Vector3d::UnitZ()).norm(), 1e-12) << c.name;
    double low = kInfinity, high = -kInfinity;
    for (int k = 0; k < contact.count; ++k) {
      const Manifold::Point& point = contact.points[static_cast<std::size_t>(k)];
      EXPECT_NEAR(point.depth, 0.01, 1e-12) << c.name;
      EXPECT_NEAR(point.position.x(), 0.0, 1e-12) << c.name;
      EXPECT_NEAR(point.position.z(), 0.0, 1e-12) << c.name;  // on the other shape
      low = std::min(low, point.position.y());
      high = std::max(high, point.position.y());
    }
    EXPECT_NEAR(high - low, c.width, 1e-5) << c.name;  // faces are wider by 1e-6
    if (c.count == 2) {
      EXPECT_NE(contact.points[0].feature, contact.points[1].feature) << c.name;
    }
  }
}

// A middle line that crosses a shape leaves it by the shortest way.
TEST(CapsuleContacts, LeaveAShapeThatTheirLineCrosses) {
  Random random;
  int overlapping = 0;
  for (int i = 0; i < 2000 / kSanitizedShare; ++i) {
    const Capsule capsule{0.15 + 0.1 * random(), 0.5 + 0.3 * random()};
    const Shape other = random_other(i % 5, &random);
    const BodyState a = pose_at(0.1 * random.vector(), random.orientation());
    const BodyState b = pose_at(0.1 * random.vector(), random.orientation());
    const Separation found = separation(capsule, a, other, b);
    if (found.gap >= 0.0) continue;  // a hull beside the capsule
    ++overlapping;
    BodyState moved = a;
    moved.position -= (found.gap - 1e-9) * found.normal;
    ASSERT_NEAR(separation(capsule, moved, other, b).gap, 1e-9, 1e-13) << i;
    // No other direction needs a shorter way.
    for (int k = 0; k < 30; ++k) {
      moved.position = a.position - 0.999 * found.gap * random.vector().normalized();
      ASSERT_LT(separation(capsule, moved, other, b).gap, 0.0) << i;
    }
  }
  EXPECT_GT(overlapping, 1900 / kSanitizedShare);
}

World world_with_capsule(const Capsule& capsule, const BodyState& state, const WorldOptions& of,
                         double slope = 0.0) {
  World world(of);
  world.add_body(make_floor(1.0, slope));
  Body body = make_body("capsule", capsule, 2.0, state.position);
  body.state = state;
  body.friction = 1.0;
  world.add_body(body);
  return world;
}

// m a = m g sin θ − F, I α = F r, a = α r: a = g sin θ / (1 + I / m r²).
TEST(Capsules, RollDownASlopeByEvents) {
  const Capsule capsule{0.2, 0.5};
  const double slope = 0.3;
  const double I = unit_inertia(capsule).z() / (0.2 * 0.2);
  const Quaterniond turn(AngleAxisd(slope, Vector3d::UnitY()));
  for (const double h : {1.0 / 60, 1.0 / 240}) {
    WorldOptions of = options(h);
    of.method = Method::kAuto;
    const BodyState start = pose_at(turn * Vector3d(0, 0, 0.2), turn * kLyingAlongY);
    World world = world_with_capsule(capsule, start, of, slope);
    const BodyId roller = world.find_body("capsule");
    const double a = kGravity * std::sin(slope) / (1.0 + I);
    while (world.time() < 2.0) {
      ASSERT_FALSE(world.step().outcome.failed);
      ASSERT_EQ(world.report().contacts.handed_over, 0);
      const double t = world.time();
      const Vector3d displacement = 0.5 * a * t * t * (turn * Vector3d::UnitX());
      ASSERT_LT((world.state(roller).position - start.position - displacement).norm(), 1e-9);
    }
  }
}

// A capsule that falls on one end lands on the other, and lies: both ends at the radius.
TEST(Capsules, ComeToRestOnBothEnds) {
  const Capsule capsule{0.2, 0.5};
  WorldOptions of = options(1.0 / 240);
  of.method = Method::kAuto;
  BodyState start = pose_at({0, 0, 0.6}, Quaterniond(AngleAxisd(1.2, Vector3d::UnitX())));
  World world = world_with_capsule(capsule, start, of);
  EXPECT_EQ(explain(world).find("events of capsules"), std::string::npos);
  World with_ball = world;
  with_ball.add_body(make_body("ball", Sphere{0.1}, 1.0, {5, 0, 0.1}));
  EXPECT_NE(explain(with_ball).find("events of capsules: time_stepping"), std::string::npos);
  double energy = world.energy();
  while (world.time() < 8.0) {
    ASSERT_FALSE(world.step().outcome.failed);
    // tolerance of a step: 1e-8 of lengths and speeds
    ASSERT_LT(world.energy() - energy, 1e-8) << world.time();
    energy = world.energy();
  }
  const BodyState& state = world.state(world.find_body("capsule"));
  EXPECT_NEAR(state.position.z(), 0.2, 1e-8);
  EXPECT_NEAR((state.orientation * Vector3d::UnitZ()).z(), 0.0, 1e-8);
}

TEST(Capsules, LieOnOtherShapes) {
  const Capsule capsule{0.1, 0.6};
  for (const Shape& below : {Shape(Box{{2, 2, 1}}), Shape(Cylinder{0.5, 1})}) {
    World world(options(1.0 / 240));
    Body ground = make_body("ground", below, 0.0, {0, 0, -0.5});
    ground.type = BodyType::kStatic;
    ground.friction = 0.5;
    world.add_body(ground);
    Body body = make_body("capsule", capsule, 1.0, {0, 0, 0.1});
    body.state.orientation = kLyingAlongY;
    body.friction = 0.5;
    const BodyId id = world.add_body(body);
    run(world, 480);
    EXPECT_LT((world.state(id).position - body.state.position).norm(), slop(world) * 1.01);
    EXPECT_LT(world.state(id).linear_velocity.norm(), 1e-6);
  }
}

TEST(Capsules, AreSavedToTheBit) {
  WorldOptions of = options(1.0 / 240);
  BodyState start = pose_at({0, 0, 0.5}, Quaterniond(AngleAxisd(1.2, Vector3d::UnitX())));
  World world = world_with_capsule({0.2, 0.5}, start, of);
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
