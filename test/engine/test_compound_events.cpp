// Event-driven contacts of bodies of several shapes, by closed forms and against bodies of one
// shape. The closed forms of test_contact_events, test_box_contacts and test_moving_contacts hold
// for compounds too (Parts/*).

#include "by_events.h"
#include "constraint_sim/engine/plan.h"
#include "constraint_sim/engine/scene.h"
#include "support.h"

namespace constraint_sim::engine {
namespace {

using Eigen::AngleAxisd;
using Eigen::Quaterniond;
using Eigen::Vector3d;

class CompoundEventsAt : public testing::TestWithParam<Carried> {};

INSTANTIATE_TEST_SUITE_P(Ticks, CompoundEventsAt,
                         testing::ValuesIn(each_setting(Method::kEventDriven)));

/// Two balls at a distance, along x of the body.
Compound two_balls(double radius, double distance) {
  const Vector3d arm(0.5 * distance, 0.0, 0.0);
  return Compound({{Sphere{radius}, {-arm, Quaterniond::Identity()}},
                   {Sphere{radius}, {arm, Quaterniond::Identity()}}});
}

/// A box, cut in two along an axis.
Compound two_halves(const Vector3d& size, int axis) {
  Vector3d half = size;
  half[axis] *= 0.5;
  const Vector3d arm = 0.5 * half[axis] * Vector3d::Unit(axis);
  return Compound(
      {{Box{half}, {-arm, Quaterniond::Identity()}}, {Box{half}, {arm, Quaterniond::Identity()}}});
}

World on_floor(const Carried& by, const Body& body, double friction, double slope = 0.0) {
  World world(by_events(by));
  world.add_body(make_floor(friction, slope));
  world.add_body(body);
  return world;
}

void expect_by_events(const World& world) {
  ASSERT_EQ(world.islands().size(), 1u);
  EXPECT_EQ(world.islands()[0].method, Method::kEventDriven);
}

// Two balls that land flat at once bounce as one body falls: v = √(2 g h), up with e v, and the
// bodies, not the pairs of shapes, have one event.
TEST_P(CompoundEventsAt, TwoBallsLandAtOnce) {
  const double radius = 0.1, height = 0.5, e = 0.5, mass = 2.0;
  Body body = with_surface(make_body("body", two_balls(radius, 0.4), mass, {0, 0, radius + height}),
                           0.0, e);
  World world = on_floor(GetParam(), body, 0.0);
  const double lands = std::sqrt(2.0 * height / kGravity), speed = kGravity * lands;
  std::vector<Event> hits;
  while (world.time() < 1.5 * lands) {
    world.step();
    for (const Event& event : world.events()) hits.push_back(event);
    if (!world.contacts().empty()) expect_by_events(world);
  }
  ASSERT_EQ(hits.size(), 2u);
  EXPECT_EQ(hits[0].kind, EventKind::kContactBegan);
  EXPECT_EQ(hits[1].kind, EventKind::kContactEnded);
  EXPECT_NEAR(hits[0].time, lands, kTime);
  EXPECT_NEAR(hits[0].impulse, mass * (1.0 + e) * speed, 1e-10);
  const double t = world.time() - lands;
  const BodyState& end = world.state(world.find_body("body"));
  EXPECT_NEAR(end.position.z(), radius + e * speed * t - 0.5 * kGravity * t * t, kPlace);
  EXPECT_LT(end.angular_velocity.norm(), 1e-11);
}

// A bar of two balls that lands on one of them: with the ball's centre at s beside the centre of
// mass, the impulse without friction is p = (1 + e) v / (1/m + s² / I).
TEST_P(CompoundEventsAt, OneBallLandsFirst) {
  const double radius = 0.1, distance = 0.4, tilt = 0.3, e = 0.6, mass = 2.0;
  const double height = radius + 0.5 * distance * std::sin(tilt) + 0.2;
  Body body =
      with_surface(make_body("body", two_balls(radius, distance), mass, {0, 0, height}), 0.0, e);
  body.state.orientation = AngleAxisd(tilt, Vector3d::UnitY());
  World world = on_floor(GetParam(), body, 0.0);
  const BodyId id = world.find_body("body");
  const double inertia = world.body(id).inertia.isZero(0.0)
                             ? mass * unit_inertia(world.body(id).shape).y()
                             : world.body(id).inertia.y();
  const double lands = std::sqrt(0.4 / kGravity), speed = kGravity * lands;
  const double s = 0.5 * distance * std::cos(tilt);
  const double impulse = (1.0 + e) * speed / (1.0 / mass + s * s / inertia);
  double found = 0.0;
  while (world.time() < lands + 1e-12) {
    world.step();
    for (const Event& event : world.events())
      if (event.kind == EventKind::kContactBegan && found == 0.0) {
        EXPECT_NEAR(event.time, lands, kTime);
        found = event.impulse;
      }
  }
  EXPECT_NEAR(found, impulse, 1e-10);
}

// A ball pair that rolls down a slope: a = g sin(s) / (1 + 2/5), exact at any time step.
TEST_P(CompoundEventsAt, TwoBallsRollDownASlope) {
  const double radius = 0.1, slope = 0.2;
  const Quaterniond tilted(AngleAxisd(slope, Vector3d::UnitY()));
  Body body = with_surface(
      make_body("body", two_balls(radius, 0.6), 2.0, tilted * Vector3d(0, 0, radius)), 1.0, 0.0);
  body.state.orientation = tilted * AngleAxisd(0.5 * kPi, Vector3d::UnitZ());
  World world = on_floor(GetParam(), body, 1.0, slope);
  run(world, static_cast<int>(std::lround(0.5 / world.options().time_step)));
  expect_by_events(world);
  const double t = world.time();
  const double along = (tilted.conjugate() * world.state(world.find_body("body")).position).x();
  EXPECT_NEAR(along, 0.5 * kGravity * std::sin(slope) / 1.4 * t * t, 1e-9);
}

// A thrown box of two halves moves as the whole box does: other corners at the seam never carry
// anything that a corner of the box would not. Positions agree to the tolerance of the method,
// enlarged by impacts.
TEST_P(CompoundEventsAt, TwoHalvesTumbleAsABox) {
  const Vector3d size(0.2, 0.3, 0.1);
  for (int axis = 0; axis < 3; ++axis) {
    Body whole = with_surface(make_body("body", Box{size}, 2.0, {0, 0, 0.4}), 0.5, 0.3);
    whole.state.angular_velocity = {1.0, -0.7, 0.4};
    Body halves = whole;
    halves.shape = two_halves(size, axis);
    World box = on_floor(GetParam(), whole, 0.5), compound = on_floor(GetParam(), halves, 0.5);
    const BodyId id = box.find_body("body");
    while (box.time() < 0.4) {
      box.step();
      compound.step();
      ASSERT_LT((box.state(id).position - compound.state(id).position).norm(), 1e-7)
          << axis << " " << box.time();
    }
    expect_by_events(compound);
  }
}

// A block of two halves stops after v² / (2 μ g), whichever corners carry it.
TEST_P(CompoundEventsAt, TwoHalvesSlideToRest) {
  const double speed = 1.0, friction = 0.5;
  for (int axis = 0; axis < 3; ++axis) {
    Body body = with_surface(
        make_body("body", two_halves({0.3, 0.3, 0.1}, axis), 2.0, {0, 0, 0.05}), friction, 0.0);
    body.state.linear_velocity.x() = speed;
    World world = on_floor(GetParam(), body, friction);
    run(world, static_cast<int>(std::lround(0.5 / world.options().time_step)));
    expect_by_events(world);
    const BodyState& end = world.state(world.find_body("body"));
    EXPECT_NEAR(end.position.x(), speed * speed / (2.0 * friction * kGravity), 1e-9) << axis;
    EXPECT_LT(end.linear_velocity.norm(), 1e-10);
  }
}

// A box that slides from one half of a static table to the other does not feel the seam, however it
// is turned, and wherever the table is: it stops after v² / (2 μ g). Gravity is along the table's
// normal, and at 1 km positions have a rounding of 1e-13 m.
TEST_P(CompoundEventsAt, ABoxSlidesOverASeam) {
  const double speed = 3.0, stops_after = speed * speed / (2.0 * 0.5 * kGravity);
  for (const bool is_elsewhere : {false, true}) {
    const Quaterniond turn =
        is_elsewhere ? Quaterniond(0.4, -0.5, 0.6, 0.3).normalized() : Quaterniond::Identity();
    const Vector3d at = is_elsewhere ? Vector3d(1e3, -700.0, 400.0) : Vector3d::Zero();
    for (int axis = 0; axis < 2; ++axis) {
      for (const double yaw : {0.0, 0.5}) {
        WorldOptions options = by_events(GetParam());
        options.gravity = turn * options.gravity;
        World world(options);
        Body table = with_surface(make_body("table", two_halves({4.0, 1.0, 0.2}, axis), 0.0,
                                            at + turn * Vector3d(0, 0, -0.1)),
                                  0.5, 0.0);
        table.type = BodyType::kStatic;
        table.state.orientation = turn;
        world.add_body(table);
        Body box = with_surface(
            make_body("box", Box{{0.2, 0.2, 0.1}}, 1.0, at + turn * Vector3d(-0.5, 0, 0.05)), 0.5,
            0.0);
        box.state.orientation = turn * AngleAxisd(yaw, Vector3d::UnitZ());
        box.state.linear_velocity = turn * Vector3d(speed, 0, 0);
        const BodyId id = world.add_body(box);
        run(world, static_cast<int>(std::lround(0.8 / world.options().time_step)));
        expect_by_events(world);
        const Vector3d end = turn.conjugate() * (world.state(id).position - at);
        EXPECT_NEAR(end.x(), -0.5 + stops_after, 1e-8) << axis << " " << yaw << " " << is_elsewhere;
        EXPECT_NEAR(end.z(), 0.05, 1e-9);
      }
    }
  }
}

// A box whose lower edge lies on the seam of two halves is pushed over the seam, from either side,
// at rest on a rough table, or while it slides along the seam of a smooth one.
TEST_P(CompoundEventsAt, ABoxWithItsEdgeOnASeamIsPushedOver) {
  const double mu = 0.5, force = 10.0;
  for (const double side : {-1.0, 1.0}) {
    for (const double along : {0.0, 0.5}) {
      World world(by_events(GetParam()));
      Body table =
          with_surface(make_body("table", two_halves({4.0, 4.0, 0.2}, 0), 0.0, {0, 0, -0.1}),
                       along > 0.0 ? 0.0 : mu, 0.0);
      table.type = BodyType::kStatic;
      world.add_body(table);
      Body box = with_surface(make_body("box", Box{{0.2, 0.2, 0.1}}, 1.0, {0.1 * side, 0, 0.05}),
                              along > 0.0 ? 0.0 : mu, 0.0);
      box.state.linear_velocity = {0, along, 0};
      const BodyId id = world.add_body(box);
      run(world, 20);  // rests, or slides along the seam
      const double start = world.time();
      // Pushed at the height of the floor, so that the box keeps its orientation: it does not tip.
      Wrench push;
      push.body = id;
      push.start = start;
      push.force = {-force * side, 0, 0};
      push.torque = {0, 0.05 * force * side, 0};
      world.add_wrench(push);
      run(world, static_cast<int>(std::lround(0.4 / world.options().time_step)));
      expect_by_events(world);
      const double t = world.time() - start;
      const double a = force - (along > 0.0 ? 0.0 : mu * kGravity);
      EXPECT_NEAR(world.state(id).position.x(), side * (0.1 - 0.5 * a * t * t), 1e-9) << side;
      EXPECT_NEAR(world.state(id).position.y(), along * world.time(), 1e-9);
      EXPECT_NEAR(world.state(id).position.z(), 0.05, 1e-9);
    }
  }
}

// A body that rests on a part without friction, beside a rough one, has no events of friction.
TEST_P(CompoundEventsAt, ASmoothPartBesideARoughOneDoesNotSlip) {
  ShapePart rough{Box{{0.2, 0.2, 0.1}}, {{0.2, 0, 0}, Quaterniond::Identity()}};
  ShapePart smooth{Box{{0.2, 0.2, 0.1}}, {{-0.2, 0, 0}, Quaterniond::Identity()}};
  rough.friction = 0.5;
  smooth.friction = 0.0;
  World world =
      on_floor(GetParam(), make_body("body", Compound({rough, smooth}), 1.0, {0, 0, 0.05}), 0.5);
  for (int i = 0; i < 20; ++i) {
    world.step();
    for (const Event& event : world.events())
      EXPECT_TRUE(event.kind != EventKind::kSlips && event.kind != EventKind::kSticks) << i;
  }
  expect_by_events(world);
}

// Each part has its own friction: a body on its rough foot sticks where tan(s) < √(μ₁ μ₂), and
// slides with a = g (sin s − μ cos s) beyond. The body's own friction is that of no part.
TEST_P(CompoundEventsAt, PartsHaveSurfacesOfTheirOwn) {
  const double rough = 0.36, floor = 0.25, mu = 0.3;
  for (const double share : {0.99, 1.01}) {
    const double slope = std::atan(share * mu);
    const Quaterniond tilted(AngleAxisd(slope, Vector3d::UnitY()));
    ShapePart foot{Box{{0.3, 0.3, 0.1}}, {{0, 0, -0.05}, Quaterniond::Identity()}};
    foot.friction = rough;
    ShapePart top{Box{{0.3, 0.3, 0.1}}, {{0, 0, 0.05}, Quaterniond::Identity()}};
    top.friction = 0.0;
    Body body = make_body("body", Compound({foot, top}), 1.0, tilted * Vector3d(0, 0, 0.1));
    body.friction = 5.0;
    body.state.orientation = tilted;
    World world = on_floor(GetParam(), body, floor, slope);
    run(world, static_cast<int>(std::lround(0.5 / world.options().time_step)));
    const double t = world.time();
    const double along = (tilted.conjugate() * world.state(world.find_body("body")).position).x();
    const double a = kGravity * (std::sin(slope) - mu * std::cos(slope));
    EXPECT_NEAR(along, share > 1.0 ? 0.5 * a * t * t : 0.0, 1e-9);
  }
}

// The larger restitution of a pair counts, as for bodies; time stepping reads the same surfaces.
TEST(CompoundSurfaces, BounceByThePartThatHits) {
  for (const Method method : {Method::kEventDriven, Method::kTimeStepping}) {
    ShapePart ball{Sphere{0.1}, {{0, 0, -0.2}, Quaterniond::Identity()}};
    ball.restitution = 0.5;
    ShapePart dead{Sphere{0.1}, {{0, 0, 0.2}, Quaterniond::Identity()}};
    WorldOptions options = engine::options(1e-3);
    options.method = method;
    World world(options);
    world.add_body(make_floor(0.0));
    const BodyId id = world.add_body(make_body("body", Compound({ball, dead}), 1.0, {0, 0, 0.5}));
    const double lands = std::sqrt(0.4 / kGravity);
    while (world.time() < lands + 2e-3) world.step();
    EXPECT_NEAR(world.state(id).linear_velocity.z(), 0.5 * kGravity * lands, 5e-3 * kGravity);
  }
}

// Cylinders and hulls as parts are left to time stepping, as such bodies are.
TEST(CompoundSurfaces, OtherPartsAreLeftToTimeStepping) {
  WorldOptions options = engine::options(1e-3);
  options.method = Method::kAuto;
  World world(options);
  world.add_body(make_floor(0.5));
  Body body = make_body("body",
                        Compound({{Box{{0.2, 0.2, 0.1}}, {}},
                                  {Cylinder{0.1, 0.3}, {{0, 0, 0.2}, Quaterniond::Identity()}}}),
                        1.0, {0, 0, 0.05});
  body.inertia = {0.1, 0.1, 0.1};
  world.add_body(body);
  run(world, 5);
  EXPECT_EQ(world.islands()[0].method, Method::kEventDriven);  // the cylinder is out of reach
  const std::vector<std::string> left = left_out(world);
  EXPECT_TRUE(std::any_of(left.begin(), left.end(), [](const std::string& line) {
    return line.find("events of cylinders") != std::string::npos;
  }));
  BodyState turned = body.state;
  turned.position.z() = 0.35;
  turned.orientation = Quaterniond(AngleAxisd(kPi, Vector3d::UnitX()));
  world.set_state(world.find_body("body"), turned);
  run(world, 5);
  EXPECT_EQ(world.islands()[0].method, Method::kTimeStepping);
}

TEST(CompoundSurfaces, AreReadSavedAndRejected) {
  const std::string text = R"(
bodies:
  - name: b
    mass: 1
    friction: 0.2
    shapes:
      - {shape: {sphere: {radius: 0.1}}, friction: 0.7, restitution: 0.1}
      - {shape: {sphere: {radius: 0.2}}, shape_pose: {position: [0, 0, 0.5]}}
)";
  const World world = load_scene(text);
  const World saved = load_scene(save_scene(world));
  for (const World* of : {&world, &saved}) {
    const auto& parts = *std::get<Compound>(of->body(of->find_body("b")).shape).parts;
    EXPECT_EQ(parts[0].friction, 0.7);
    EXPECT_EQ(parts[0].restitution, 0.1);
    EXPECT_FALSE(parts[1].friction.has_value());
  }
  EXPECT_EQ(world.state_hash(), saved.state_hash());
  const auto with = [&](const char* from, const char* to) {
    std::string other = text;
    other.replace(other.find(from), std::string(from).size(), to);
    return other;
  };
  EXPECT_NE(load_scene(with("friction: 0.7", "friction: 0.6")).state_hash(), world.state_hash());
  EXPECT_NE(refusal([&] {
              load_scene(with("friction: 0.7", "friction: -1"));
            }).find("shapes[0].friction"),
            std::string::npos);
  EXPECT_NE(refusal([&] {
              load_scene(with("restitution: 0.1", "restitution: 2"));
            }).find("shapes[0].restitution"),
            std::string::npos);
}

}  // namespace
}  // namespace constraint_sim::engine
