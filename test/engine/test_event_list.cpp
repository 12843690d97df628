// What World::events() tells of a step: kinds, whose, and the moments within the tick. Oracles:
// closed forms of the moments, right to 1e-9 s at any tick, and of the impulses.

#include "by_events.h"
#include "pendulum.h"
#include "support.h"

namespace constraint_sim::engine {
namespace {

using Eigen::Vector3d;

constexpr double kTime = 1e-9;  // [s], as the events themselves are located in test_events.cpp

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

class EventList : public testing::TestWithParam<Carried> {};

INSTANTIATE_TEST_SUITE_P(AtTicks, EventList, testing::ValuesIn(each_way(Method::kAuto)));

TEST_P(EventList, ARopeIsToldWhenItIsTaut) {
  World world(by_events(GetParam()));
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
  World world(by_events(GetParam()));
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

TEST_P(EventList, AMotorAtItsLimitIsToldUntilItHasCaughtUp) {
  constexpr double kMass = 2.0, kForce = 3.0, kSpeed = 0.6;
  World world(by_events(GetParam(), 0.0));
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
  World world(by_events(GetParam(), 0.0));
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
  World world(by_events(GetParam()));
  const BodyId id = world.add_body(make_body("bob", Sphere{0.1}, 1.0, {1.0, 0.0, 0.0}));
  Joint joint = hang("rod", id, rod(1.0));
  joint.break_force = 1.5 * kGravity;  // 3 m g sin φ at φ = 30°
  const JointId rod_id = world.add_joint(joint);
  const std::vector<Event> events = events_of(&world, 1.0);
  ASSERT_EQ(events.size(), 1u);
  EXPECT_EQ(events[0].kind, EventKind::kBroken);
  EXPECT_EQ(events[0].joint, rod_id);
  EXPECT_STREQ(name(events[0].kind), "broken");
  EXPECT_NEAR(events[0].time, time_of_fall(0.5 * kPi, kPi / 3.0, 1.0), kTime);
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
