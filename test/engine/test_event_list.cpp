// What World::events() tells of a step: kinds, whose, and the moments within the tick. Oracles:
// closed forms of the moments, right to 1e-9 s at any tick, and of the impulses.

#include "support.h"

namespace constraint_sim::engine {
namespace {

using Eigen::Vector3d;

constexpr double kTime = 1e-9;  // [s], as the events themselves are located in test_events.cpp

WorldOptions automatic(double time_step, double gravity = kGravity) {
  WorldOptions options = engine::options(time_step, gravity);
  options.method = Method::kAuto;
  options.tolerance = 1e-10;
  return options;
}

/// All events of so many seconds; each is to be within its tick.
std::vector<Event> events_of(World* world, double seconds) {
  std::vector<Event> all;
  while (world->time() < seconds) {
    const double start = world->time();
    world->step();
    for (const Event& event : world->events()) {
      EXPECT_GE(event.time, start);
      EXPECT_LE(event.time, world->time());
      all.push_back(event);
    }
  }
  return all;
}

class EventList : public testing::TestWithParam<double> {};

INSTANTIATE_TEST_SUITE_P(AtTicks, EventList,
                         testing::Values(1.0 / 30, 1.0 / 60, 1.0 / 240, 1.0 / 1000));

TEST_P(EventList, ARopeIsToldWhenItIsTaut) {
  World world(automatic(GetParam()));
  const BodyId id = world.add_body(make_body("ball", Sphere{0.1}, 2.0, {0.0, 0.0, -0.3}));
  const JointId rope_id = world.add_joint(hang("rope", id, rope(1.0)));
  const std::vector<Event> events = events_of(&world, 1.0);
  ASSERT_EQ(events.size(), 1u);
  const double taut = std::sqrt(2.0 * 0.7 / kGravity);
  EXPECT_EQ(events[0].kind, EventKind::kRopeTaut);
  EXPECT_EQ(events[0].joint, rope_id);
  EXPECT_EQ(events[0].coordinate, -1);
  EXPECT_EQ(events[0].body_b, id);
  EXPECT_NEAR(events[0].time, taut, kTime);
  EXPECT_NEAR(events[0].impulse, 2.0 * kGravity * taut, 1e-8);  // all of m v
}

// each bounce reaches the limit and leaves it at the same time, with (1 + e) m v
TEST_P(EventList, BouncesOnALimitAreTold) {
  constexpr double kRestitution = 0.5, kMass = 3.0, kHeight = 0.5;
  World world(automatic(GetParam()));
  const BodyId id = world.add_body(make_body("ball", Sphere{0.1}, kMass, {0.0, 0.0, kHeight}));
  Joint joint =
      make_joint("slider", kWorldBody, Vector3d::Zero(), id, Vector3d::Zero(), JointKind::kSlider);
  joint.coordinates[0].lower = 0.0;
  joint.coordinates[0].limit_restitution = kRestitution;
  world.add_joint(joint);
  const std::vector<Event> events = events_of(&world, 1.5);
  double t = std::sqrt(2.0 * kHeight / kGravity), v = kGravity * t;
  ASSERT_GT(events.size(), 8u);
  for (std::size_t i = 0; i < 4; ++i) {
    EXPECT_EQ(events[2 * i].kind, EventKind::kLimitReached);
    EXPECT_EQ(events[2 * i].coordinate, 0);
    EXPECT_NEAR(events[2 * i].time, t, kTime);
    EXPECT_NEAR(events[2 * i].impulse, (1.0 + kRestitution) * kMass * v, 1e-8);
    EXPECT_EQ(events[2 * i + 1].kind, EventKind::kLimitLeft);
    EXPECT_EQ(events[2 * i + 1].time, events[2 * i].time);
    v *= kRestitution;
    t += 2.0 * v / kGravity;
  }
  EXPECT_EQ(events.back().kind, EventKind::kLimitReached);  // and stays there
}

// A ball that bounces on a floor or on the stop of its slider comes to rest after
// √(2 h/g) (1 + e)/(1 − e). That its place rounds to 7e-18 m moves the time of a bounce of v by as
// much over v, and with it all that come: by 3e-12 s for e = 0.9 and 4e-5 m/s, the least that is
// followed.
TEST_P(EventList, ComingToRestIsToldWhereTheLastBounceIs) {
  constexpr double kHeight = 0.05;
  for (const auto& [e, tolerance] : {std::pair(0.5, 2e-13), {0.9, 6e-12}, {0.99, 9e-10}}) {
    for (const bool is_stop : {false, true}) {
      World world(automatic(GetParam()));
      Body ball = make_body("ball", Sphere{0.1}, 3.0, {0.0, 0.0, 0.1 + kHeight});
      ball.restitution = e;
      const BodyId id = world.add_body(ball);
      if (is_stop) {
        Joint joint = make_joint("slider", kWorldBody, Vector3d::Zero(), id, Vector3d::Zero(),
                                 JointKind::kSlider);
        joint.coordinates[0].lower = 0.1;
        joint.coordinates[0].limit_restitution = e;
        world.add_joint(joint);
      } else {
        world.add_body(make_floor(0.0));
      }
      const double rests = std::sqrt(2.0 * kHeight / kGravity) * (1.0 + e) / (1.0 - e);
      const std::vector<Event> events = events_of(&world, rests + 0.1);
      ASSERT_FALSE(events.empty());
      EXPECT_EQ(events.back().kind, is_stop ? EventKind::kLimitReached : EventKind::kContactBegan);
      EXPECT_NEAR(events.back().time, rests, tolerance) << e << (is_stop ? ", stop" : "");
    }
  }
}

TEST_P(EventList, AMotorAtItsLimitIsToldUntilItHasCaughtUp) {
  constexpr double kMass = 2.0, kForce = 3.0, kSpeed = 0.6;
  World world(automatic(GetParam(), 0.0));
  const BodyId id = world.add_body(make_body("load", Sphere{0.1}, kMass, Vector3d::Zero()));
  Joint joint =
      make_joint("slider", kWorldBody, Vector3d::Zero(), id, Vector3d::Zero(), JointKind::kSlider);
  joint.coordinates[0].motor.emplace();
  joint.coordinates[0].motor->bias = kSpeed;
  joint.coordinates[0].motor->max_force = kForce;
  world.add_joint(joint);
  const std::vector<Event> events = events_of(&world, 1.0);
  ASSERT_EQ(events.size(), 1u);  // that it begins at its limit is no event
  EXPECT_EQ(events[0].kind, EventKind::kReleased);
  EXPECT_NEAR(events[0].time, kMass * kSpeed / kForce, kTime);
}

TEST_P(EventList, FrictionThatStopsASliderIsTold) {
  constexpr double kMass = 2.0, kFriction = 3.0, kSpeed = 1.1;
  World world(automatic(GetParam(), 0.0));
  Body body = make_body("slides", Sphere{0.1}, kMass, Vector3d::Zero());
  body.state.linear_velocity.z() = kSpeed;
  const BodyId id = world.add_body(body);
  Joint joint =
      make_joint("slider", kWorldBody, Vector3d::Zero(), id, Vector3d::Zero(), JointKind::kSlider);
  joint.coordinates[0].friction = kFriction;
  world.add_joint(joint);
  const std::vector<Event> events = events_of(&world, 1.0);
  ASSERT_EQ(events.size(), 1u);
  EXPECT_EQ(events[0].kind, EventKind::kSticks);
  EXPECT_NEAR(events[0].time, kSpeed * kMass / kFriction, kTime);
}

// a rope that breaks by the mean force of an impulse does so at the end of a step; a rod that a
// growing force breaks at that moment
TEST_P(EventList, AJointThatBreaksIsToldOnce) {
  World world(automatic(GetParam()));
  const BodyId id = world.add_body(make_body("bob", Sphere{0.1}, 1.0, {1.0, 0.0, 0.0}));
  Joint joint = hang("rod", id, rod(1.0));
  joint.break_force = 1.5 * kGravity;  // 3 m g sin φ at φ = 30°
  const JointId rod_id = world.add_joint(joint);
  const std::vector<Event> events = events_of(&world, 1.0);
  ASSERT_EQ(events.size(), 1u);
  EXPECT_EQ(events[0].kind, EventKind::kBroken);
  EXPECT_EQ(events[0].joint, rod_id);
  EXPECT_STREQ(name(events[0].kind), "broken");
  // from there it flies with v² = 2 g sin φ: where it is says for how long
  const double speed = std::sqrt(kGravity);
  const Vector3d x(std::cos(kPi / 6), 0.0, -0.5), v = speed * Vector3d(-0.5, 0.0, -x.x());
  const double since = world.time() - events[0].time;
  const Vector3d place = x + since * v - Vector3d(0.0, 0.0, 0.5 * kGravity * since * since);
  EXPECT_LT((world.state(id).position - place).norm(), 1e-8);
}

TEST(EventList, JointsThatImpulsesBreakAreToldAtTheEndOfTheStep) {
  World world(options(0.01));
  const BodyId id = world.add_body(make_body("ball", Sphere{0.1}, 1.0, {0.0, 0.0, -1.0}));
  Joint joint = hang("rod", id, rod(1.0));
  joint.break_force = 0.5 * kGravity;
  const JointId rod_id = world.add_joint(joint);
  world.step();
  ASSERT_EQ(world.events().size(), 1u);
  EXPECT_EQ(world.events()[0].kind, EventKind::kBroken);
  EXPECT_EQ(world.events()[0].time, world.time());
  World snapshot;
  world.take_snapshot(&snapshot);
  EXPECT_EQ(snapshot.events().size(), 1u);
  world.step();
  EXPECT_TRUE(world.events().empty());
  world.set_broken(rod_id, false);
  world.step();
  EXPECT_EQ(world.events().size(), 1u);
  world.remove_joint(rod_id);  // whose id the event has
  EXPECT_TRUE(world.events().empty());
}

}  // namespace
}  // namespace constraint_sim::engine
