// Joints that break in an event-driven group with contacts. Oracles: closed forms of the time at
// which the force reaches the joint's limit, and of the fall after that.

#include "by_events.h"
#include "engine/methods/event_driven/event_watch.h"
#include "support.h"

namespace constraint_sim::engine {
namespace {

using Eigen::Vector3d;

// Forces are accurate to the tolerance of 1e-10 m/s; a force that grows with some 10 N/s reaches
// its limit at a time accurate to 1e-12 s.
constexpr double kBreaks = 1e-11;  // [s]
constexpr double kFalls = 1e-10;   // [m]

class BreakingBesideContactsAt : public testing::TestWithParam<Carried> {};

INSTANTIATE_TEST_SUITE_P(Ticks, BreakingBesideContactsAt,
                         testing::ValuesIn(each_setting(Method::kEventDriven)));

// A box hangs by rods from a mast on another box, which stands on the floor on four corners. The
// rods' length changes as a sin ωt, so they carry m (g − a ω cos ωt) together; they break where cos
// ωt is kWhere, and the box falls onto the other one, e = 0. One rod, or two in the same place that
// share the load: where the first breaks, the second is overloaded at once.
TEST_P(BreakingBesideContactsAt, ARodBreaksAboveABoxOnTheFloor) {
  constexpr double kMass = 2.0, kBase = 5.0, kSpeed = 0.5, kWhere = -0.3, kTop = 1.05;
  constexpr double kOmega = 2.0 * kPi;
  for (const int rods : {1, 2}) {
    World world(by_events(GetParam()));
    world.add_body(plane("floor", Vector3d::Zero(), Vector3d::UnitZ(), 0.5, 0.0));
    const BodyId base = world.add_body(
        with_surface(make_body("base", Box{{0.8, 0.6, 0.4}}, kBase, {0.0, 0.0, 0.2}), 0.5, 0.0));
    const BodyId box = world.add_body(
        with_surface(make_body("box", Box{{0.3, 0.3, 0.3}}, kMass, {0.0, 0.0, kTop}), 0.5, 0.0));
    JointId last;
    for (int i = 0; i < rods; ++i) {
      Joint joint =
          make_joint("rod" + std::to_string(i), base, {0.0, 0.0, 1.8}, box, Vector3d::Zero());
      joint.collide_connected = true;
      joint.motor.amplitude = kSpeed;
      joint.motor.frequency = 1.0;
      joint.break_force = kMass * (kGravity - kSpeed * kOmega * kWhere) / rods;
      last = world.add_joint(joint);
    }
    const double breaks = std::acos(kWhere) / kOmega;
    const double from = kTop - kSpeed / kOmega * (1.0 - kWhere) - 0.55;
    const double speed = kSpeed * std::sin(kOmega * breaks);
    const double falls = (std::sqrt(speed * speed + 2.0 * kGravity * from) - speed) / kGravity;
    std::vector<Event> events;
    while (world.time() < 1.0 - 1e-9) {
      const std::vector<Event> now = advance(&world, GetParam());
      events.insert(events.end(), now.begin(), now.end());
      const double t = world.time(), since = t - breaks;
      const double z =
          since < 0.0 ? kTop - kSpeed / kOmega * (1.0 - std::cos(kOmega * t))
                      : 0.55 + std::max(0.0, from - speed * since - 0.5 * kGravity * since * since);
      ASSERT_LT((world.state(box).position - Vector3d(0.0, 0.0, since < falls ? z : 0.55)).norm(),
                kFalls)
          << rods << ' ' << t;
      ASSERT_LT((world.state(base).position - Vector3d(0.0, 0.0, 0.2)).norm(), kPlace) << t;
      ASSERT_EQ(world.joint_state(last).broken, since > 0.0) << t;
    }
    const std::vector<Event> broken = of_kind(events, EventKind::kBroken);
    ASSERT_EQ(broken.size(), static_cast<std::size_t>(rods));
    for (const Event& event : broken) EXPECT_NEAR(event.time, breaks, kBreaks);
    const std::vector<Event> hits = of_kind(events, EventKind::kContactBegan);
    ASSERT_EQ(hits.size(), 1u);
    EXPECT_NEAR(hits[0].time, breaks + falls, kBreaks);
    EXPECT_NEAR(hits[0].impulse, kMass * (speed + kGravity * falls), 1e-9);
    EXPECT_NEAR(contact_force_on(world, base).z(), kBase * kGravity, 1e-9);
    EXPECT_NEAR(contact_force_on(world, box).z(), kMass * kGravity, 1e-9);
  }
}

// A ball slides along a shelf that is welded to the world at its end and breaks at a limit of its
// moment. Both fall, and neither rotates. The time is not at the end of a tick, where the force
// equals its bound to 1e-9.
TEST_P(BreakingBesideContactsAt, AShelfBreaksUnderABallThatSlides) {
  constexpr double kShelf = 3.0, kBall = 2.0, kSpeed = 1.0, kWhere = 0.56347;
  World world(by_events(GetParam()));
  const BodyId shelf =
      world.add_body(make_body("shelf", Box{{1.0, 0.4, 0.1}}, kShelf, {0.5, 0.0, 0.0}));
  Body ball = make_body("ball", Sphere{0.1}, kBall, {0.1, 0.0, 0.15});
  ball.state.linear_velocity.x() = kSpeed;
  const BodyId id = world.add_body(ball);
  Joint joint;
  joint.name = "weld";
  joint.kind = JointKind::kWeld;
  joint.body_b = shelf;
  joint.anchor_b = {-0.5, 0.0, 0.0};
  joint.break_torque = kGravity * (0.5 * kShelf + kWhere * kBall);
  world.add_joint(joint);
  const double breaks = (kWhere - 0.1) / kSpeed;
  std::vector<Event> events;
  while (world.time() < 0.8 - 1e-9) {
    const std::vector<Event> now = advance(&world, GetParam());
    events.insert(events.end(), now.begin(), now.end());
    const double since = std::max(0.0, world.time() - breaks);
    const Vector3d fallen(0.0, 0.0, -0.5 * kGravity * since * since);
    ASSERT_LT((world.state(shelf).position - Vector3d(0.5, 0.0, 0.0) - fallen).norm(), kFalls);
    ASSERT_LT((world.state(id).position - Vector3d(0.1 + kSpeed * world.time(), 0.0, 0.15) - fallen)
                  .norm(),
              kFalls);
    ASSERT_LT(world.state(shelf).angular_velocity.norm(), 1e-10);
  }
  const std::vector<Event> broken = of_kind(events, EventKind::kBroken);
  ASSERT_EQ(broken.size(), 1u);
  EXPECT_NEAR(broken[0].time, breaks, kBreaks);
}

// A ball rebounds from a bob that a rod holds like a wall, e = 1. The impulse 2 m v of the rod
// lasts for the duration of impacts, and breaks it at the moment of the hit, after the rebound.
TEST_P(BreakingBesideContactsAt, AnImpactBreaksAtItsMoment) {
  constexpr double kMass = 0.5, kSpeed = 3.0, kHits = 0.1039;
  for (const double bears : {0.99, 1.01}) {
    World world(by_events(GetParam(), 0.0));
    const BodyId bob =
        world.add_body(with_surface(make_body("bob", Sphere{0.1}, 2.0, {1.0, 0.0, 0.0}), 0.0, 1.0));
    Body ball = with_surface(
        make_body("ball", Sphere{0.1}, kMass, {1.2 + kSpeed * kHits, 0.0, 0.0}), 0.0, 1.0);
    ball.state.linear_velocity.x() = -kSpeed;
    const BodyId id = world.add_body(ball);
    Joint joint = hang("rod", bob, rod(1.0));
    joint.break_force = bears * 2.0 * kMass * kSpeed / kImpactDuration;
    const JointId rod_id = world.add_joint(joint);
    const std::vector<Event> events = advance(&world, 0.5);
    EXPECT_EQ(world.joint_state(rod_id).broken, bears < 1.0);
    EXPECT_NEAR(world.state(id).position.x(), 1.2 + kSpeed * (world.time() - kHits), kPlace);
    EXPECT_LT((world.state(bob).position - Vector3d(1.0, 0.0, 0.0)).norm(), kPlace);
    const std::vector<Event> broken = of_kind(events, EventKind::kBroken);
    ASSERT_EQ(broken.size(), bears < 1.0 ? 1u : 0u);
    for (const Event& event : broken) EXPECT_NEAR(event.time, kHits, kBreaks);
  }
}

// Two rods hold a box on a frictionless floor, and one of them breaks: the other, which takes over
// its number in the group, stays intact and holds.
TEST_P(BreakingBesideContactsAt, OneThatBreaksLeavesTheOther) {
  World world(by_events(GetParam()));
  world.add_body(with_surface(make_floor(0.0), 0.0, 0.0));
  const BodyId box = world.add_body(
      with_surface(make_body("box", Box{{0.4, 0.4, 0.4}}, 2.0, {0.0, 0.0, 0.2}), 0.0, 0.0));
  const auto hold = [&](const std::string& name, const Vector3d& from, double bears) {
    Joint joint = make_joint(name, kWorldBody, from, box, Vector3d::Zero());
    joint.break_force = bears;
    return world.add_joint(joint);
  };
  const JointId weak = hold("weak", {0.0, -1.0, 0.2}, 1.0);
  const JointId strong = hold("strong", {-1.0, 0.0, 0.2}, 0.0);
  const Wrench pull{box, {3.0, 3.0, 0.0}, Vector3d::Zero(), 0.0, INFINITY};
  world.add_wrench(pull);
  const std::vector<Event> broken = of_kind(advance(&world, 0.5), EventKind::kBroken);
  ASSERT_EQ(broken.size(), 1u);
  EXPECT_EQ(broken[0].joint, weak);
  EXPECT_FALSE(world.joint_state(strong).broken);
  EXPECT_NEAR((world.state(box).position - Vector3d(-1.0, 0.0, 0.2)).norm(), 1.0, kPlace);
  EXPECT_GT(world.state(box).position.y(), 0.1);
}

// Scene files refuse a torque limit of a distance joint too, so a saved joint could not be loaded.
TEST(Breaking, ALengthBearsNoTorque) {
  World world(by_events(1.0 / 60));
  Joint joint = hang("length", world.add_body(make_body("bob", Sphere{0.1}, 1.0, {1.0, 0.0, 0.0})));
  joint.break_torque = 1.0;
  for (const JointKind kind : {JointKind::kDistance, JointKind::kFreeDistance}) {
    joint.kind = kind;
    EXPECT_EQ(refusal([&] { world.add_joint(joint); }),
              "break_torque: a distance joint has no torque, got 1");
  }
}

}  // namespace
}  // namespace constraint_sim::engine
