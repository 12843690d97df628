// Events of a step in World::events(): kind, joint or bodies, and time within the tick. Oracles:
// closed forms of the times, correct to 1e-9 s at any tick, and of the impulses.

#include "by_events.h"
#include "constraint_sim/engine/scene.h"
#include "constraint_sim/engine/snapshot.h"
#include "pendulum.h"
#include "rotation_between.h"
#include "support.h"

namespace constraint_sim::engine {
namespace {

using Eigen::Vector3d;

/// Returns all events of a duration; each has to be within its tick.
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

INSTANTIATE_TEST_SUITE_P(AtTicks, EventList, testing::ValuesIn(each_setting(Method::kAuto)));

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
  EXPECT_NEAR(events[0].time, taut, kTimeAtTicks);
  EXPECT_NEAR(events[0].impulse, 2.0 * kGravity * taut, 1e-8);  // the full m v
}

// Each bounce reaches and leaves the limit at one time, with (1 + e) m v.
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
    EXPECT_NEAR(events[2 * i].time, t, kTimeAtTicks);
    EXPECT_NEAR(events[2 * i].impulse, (1.0 + kRestitution) * kMass * v, 1e-8);
    EXPECT_EQ(events[2 * i + 1].kind, EventKind::kLimitLeft);
    EXPECT_EQ(events[2 * i + 1].time, events[2 * i].time);
    v *= kRestitution;
    t += 2.0 * v / kGravity;
  }
  EXPECT_EQ(events.back().kind, EventKind::kLimitReached);  // the mass stays at its limit
}

// A ball that bounces on a floor or on the stop of its slider comes to rest after √(2 h/g) (1 +
// e)/(1 − e). Rounding of its position by 7e-18 m shifts the time of a bounce of speed v by 7e-18
// m/v, and all later ones: by 3e-12 s for e = 0.9 and 4e-5 m/s, the slowest bounce that is
// followed.
TEST_P(EventList, ComingToRestIsToldWhereTheLastBounceIs) {
  constexpr double kHeight = 0.05;
  for (const auto& [e, tolerance] : {std::pair(0.5, 2e-13), {0.9, 6e-12}, {0.99, 9e-10}}) {
    for (const bool is_stop : {false, true}) {
      World world(by_events(GetParam()));
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

/// A load of 2 kg at 0, on a slider along x up to 0.2 m, where a motor pushes it with 3 N.
JointId push_into_limit(World* world) {
  Body load = make_body("load", Sphere{0.1}, 2.0, Vector3d::Zero());
  load.no_collision = true;
  const BodyId id = world->add_body(load);
  Joint joint =
      make_joint("slider", kWorldBody, Vector3d::Zero(), id, Vector3d::Zero(), JointKind::kSlider);
  joint.frame_a = rotation_between(Vector3d::UnitZ(), Vector3d::UnitX());
  joint.coordinates[0].upper = 0.2;
  joint.coordinates[0].motor.emplace();
  joint.coordinates[0].motor->bias = 5.0;
  joint.coordinates[0].motor->max_force = 3.0;
  return world->add_joint(joint);
}

const double kPushed = std::sqrt(2.0 * 0.2 * 2.0 / 3.0);  // time of arrival [s]

// The limit carries the full force of the motor.
TEST_P(EventList, AMotorThatPushesIntoItsLimitIsNotReleased) {
  for (const Method method :
       {Method::kAuto, Method::kEventDriven, Method::kRungeKutta, Method::kSequentialImpulses}) {
    WorldOptions options = by_events(GetParam(), 0.0);
    options.method = method;
    World world(options);
    const JointId slider = push_into_limit(&world);
    const std::vector<Event> events = events_of(&world, 1.0);
    EXPECT_TRUE(world.joint_state(slider).saturated) << name(method);
    EXPECT_NEAR(world.joint_state(slider).coordinates[0].position, 0.2, 1e-6) << name(method);
    if (world.report().costs.islands[index_of(Method::kEventDriven)] == 0) continue;  // no times
    ASSERT_EQ(events.size(), 1u) << name(method);
    EXPECT_EQ(events[0].kind, EventKind::kLimitReached);
    EXPECT_NEAR(events[0].time, kPushed, kTimeAtTicks);
  }
}

// Changes by an edit are reported at the beginning of the tick: a motor that stops at the limit has
// no force; one that reverses leaves the limit, at full force until it reaches its rate.
TEST_P(EventList, WhatEditsOfAMotorChangeIsTold) {
  World world(by_events(GetParam(), 0.0));
  const JointId slider = push_into_limit(&world);
  events_of(&world, 1.0);
  Motor motor = *world.joint(slider).coordinates[0].motor;
  motor.bias = 0.0;
  world.set_motor(slider, 0, motor);
  const double stops = world.time();
  std::vector<Event> events = events_of(&world, 1.3);
  ASSERT_EQ(events.size(), 1u);
  EXPECT_EQ(events[0].kind, EventKind::kReleased);
  EXPECT_EQ(events[0].time, stops);
  EXPECT_FALSE(world.joint_state(slider).saturated);
  motor.bias = -0.3;
  world.set_motor(slider, 0, motor);
  const double leaves = world.time();
  events = events_of(&world, 2.0);
  ASSERT_EQ(events.size(), 3u);
  EXPECT_EQ(events[0].kind, EventKind::kLimitLeft);
  EXPECT_EQ(events[0].time, leaves);
  EXPECT_EQ(events[1].kind, EventKind::kSaturated);
  EXPECT_EQ(events[1].time, leaves);
  EXPECT_EQ(events[2].kind, EventKind::kReleased);
  EXPECT_NEAR(events[2].time, leaves + 2.0 * 0.3 / 3.0, kTimeAtTicks);
}

// A saved world and one from a snapshot report the same events in the next tick. A saved world
// restarts its substeps.
TEST(EventList, WhatWasSavedTellsTheSame) {
  World world(by_events(1.0 / 60));
  world.add_body(make_floor(0.5));
  const JointId slider = push_into_limit(&world);
  Body box = make_body("box", Box{{0.6, 0.5, 0.4}}, 2.0, {2.0, 0.0, 0.2});
  box.friction = 0.5;
  Wrench wrench;
  wrench.body = world.add_body(box);
  wrench.force = {1.2 * 0.5 * 2.0 * kGravity, 0.0, 0.0};
  wrench.start = 0.2;
  wrench.end = 0.4;
  world.add_wrench(wrench);
  unsigned told = 0;
  while (world.time() < 1.0) {
    World saved = load_scene(save_scene(world)), restored = read_snapshot(write_snapshot(world));
    if (world.time() > 0.9)
      for (World* of : {&world, &saved, &restored}) of->set_motor(slider, 0, std::nullopt);
    world.step();
    told += static_cast<unsigned>(world.events().size());
    for (World* of : {&saved, &restored}) {
      of->step();
      ASSERT_EQ(of->events().size(), world.events().size()) << world.time();
      for (std::size_t k = 0; k < world.events().size(); ++k) {
        EXPECT_EQ(of->events()[k].kind, world.events()[k].kind);
        EXPECT_NEAR(of->events()[k].time, world.events()[k].time,
                    of == &saved ? kTimeAtTicks : 0.0);
      }
    }
  }
  EXPECT_EQ(told, 3u);  // slips, sticks, limit_reached
}

// A rope of at least 0.5 m is wound in at 0.25 m/s with 50 N until at most 1 % of the length is
// left, alone and beside a wall that its load touches.
TEST_P(EventList, AWinchAtTheEndOfItsTravelIsSaturated) {
  constexpr double kEnd = 0.99 * 0.5 / 0.25;
  for (const bool has_wall : {false, true}) {
    for (const Method method : {Method::kAuto, Method::kSequentialImpulses}) {
      WorldOptions options = by_events(GetParam());
      options.method = method;
      World world(options);
      Body load = make_body("load", Sphere{0.1}, 2.0, {0.0, 0.0, -1.0});
      load.state.linear_velocity.z() = 0.25;
      const BodyId id = world.add_body(load);
      if (has_wall) world.add_body(plane("wall", {-0.1, 0.0, 0.0}, Vector3d::UnitX(), 0.0, 0.0));
      Joint joint = hang("rope", id, between(0.5, 1.0));
      joint.motor.bias = -0.25;
      joint.motor.max_force = 50.0;
      const JointId rope_id = world.add_joint(joint);
      std::vector<Event> events = events_of(&world, kEnd - 2.0 * GetParam());
      EXPECT_FALSE(world.joint_state(rope_id).saturated) << name(method);
      events = events_of(&world, 2.3);
      EXPECT_TRUE(world.joint_state(rope_id).saturated) << name(method);
      if (method == Method::kSequentialImpulses) continue;
      std::vector<double> saturated;
      for (const Event& event : events) {
        EXPECT_NE(event.kind, EventKind::kReleased);
        if (event.kind == EventKind::kSaturated) saturated.push_back(event.time);
      }
      ASSERT_EQ(saturated.size(), 1u) << has_wall;
      EXPECT_NEAR(saturated[0], kEnd, GetParam());
    }
  }
}

// The effect of a push from the beginning of a tick is reported like an event within the tick.
TEST_P(EventList, WhatBeginsWithATickIsTold) {
  World world(by_events(GetParam()));
  world.add_body(make_floor(0.5));
  Body box = make_body("box", Box{{0.6, 0.5, 0.4}}, 2.0, {0.0, 0.0, 0.2});
  box.friction = 0.5;
  const BodyId id = world.add_body(box);
  EXPECT_TRUE(events_of(&world, 0.1).empty());  // initial contact is no event
  Wrench wrench;
  wrench.body = id;
  wrench.force = {1.2 * 0.5 * 2.0 * kGravity, 0.0, 0.0};
  world.add_wrench(wrench);
  double start = world.time();
  std::vector<Event> events = events_of(&world, 0.2);
  ASSERT_EQ(events.size(), 1u);
  EXPECT_EQ(events[0].kind, EventKind::kSlips);
  EXPECT_EQ(events[0].time, start);
  wrench.force = {0.0, 0.0, 50.0};
  world.add_wrench(wrench);
  start = world.time();
  events = events_of(&world, 0.3);
  ASSERT_EQ(events.size(), 1u);
  EXPECT_EQ(events[0].kind, EventKind::kContactEnded);
  EXPECT_EQ(events[0].time, start);
}

// A lift is reported also without friction, and from sleep.
TEST_P(EventList, ALiftIsToldOfWhatSleptWithoutFriction) {
  World world(by_events(GetParam()));
  world.add_body(make_floor(0.0));
  const BodyId id = world.add_body(make_body("ball", Sphere{0.1}, 2.0, {0.0, 0.0, 0.1}));
  EXPECT_TRUE(events_of(&world, 3.0).empty());
  EXPECT_EQ(world.report().costs.asleep, 1u);
  Wrench wrench;
  wrench.body = id;
  wrench.force = {0.0, 0.0, 50.0};
  world.add_wrench(wrench);
  const double start = world.time();
  const std::vector<Event> events = events_of(&world, 3.2);
  ASSERT_EQ(events.size(), 1u);
  EXPECT_EQ(events[0].kind, EventKind::kContactEnded);
  EXPECT_EQ(events[0].time, start);
}

// A ball that comes to rest in a corner without gravity touches three walls from then on.
TEST_P(EventList, ContactsWithoutForceDoNotComeAndGo) {
  World world(by_events(GetParam(), 0.0));
  for (int i = 0; i < 3; ++i) {
    Body body = plane("wall", Vector3d::Zero(), Vector3d::Unit(i), 0.0, 0.0);
    body.name += std::to_string(i);
    world.add_body(body);
  }
  Body ball = make_body("ball", Sphere{0.1}, 1.0, {1.1, 1.1, 1.1});
  ball.state.linear_velocity = {-1.0, -1.0, -1.0};
  ball.state.angular_velocity = {3.0, 2.0, 1.0};
  world.add_body(ball);
  const std::vector<Event> events = events_of(&world, 4.0);
  ASSERT_EQ(events.size(), 3u);
  for (const Event& event : events) {
    EXPECT_EQ(event.kind, EventKind::kContactBegan);
    EXPECT_NEAR(event.time, 1.0, kTimeAtTicks);
  }
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
  ASSERT_EQ(events.size(), 1u);  // starting at the limit is no event
  EXPECT_EQ(events[0].kind, EventKind::kReleased);
  EXPECT_NEAR(events[0].time, kMass * kSpeed / kForce, kTimeAtTicks);
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
  EXPECT_NEAR(events[0].time, kSpeed * kMass / kFriction, kTimeAtTicks);
}

// A rod under a growing force breaks at the time of its limit.
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
  EXPECT_NEAR(events[0].time, time_of_fall(0.5 * kPi, kPi / 3.0, 1.0), kTimeAtTicks);
  // the free bob flies with v² = 2 g sin φ; its position gives the time of flight
  const double speed = std::sqrt(kGravity);
  const Vector3d x(std::cos(kPi / 6), 0.0, -0.5), v = speed * Vector3d(-0.5, 0.0, -x.x());
  const double since = world.time() - events[0].time;
  const Vector3d place = x + since * v - Vector3d(0.0, 0.0, 0.5 * kGravity * since * since);
  EXPECT_LT((world.state(id).position - place).norm(), 1e-8);
}

TEST_P(EventList, AJointThatBearsTooLittleBreaksAtOnce) {
  World world(by_events(GetParam()));
  const BodyId id = world.add_body(make_body("bob", Sphere{0.1}, 1.0, {0.0, 0.0, -1.0}));
  Joint joint = hang("rod", id, rod(1.0));
  joint.break_force = 0.5 * kGravity;
  world.add_joint(joint);
  const std::vector<Event> events = events_of(&world, 1.0);
  ASSERT_EQ(events.size(), 1u);
  EXPECT_EQ(events[0].kind, EventKind::kBroken);
  EXPECT_EQ(events[0].time, 0.0);
  const double fallen = 0.5 * kGravity * world.time() * world.time();
  EXPECT_NEAR(world.state(id).position.z(), -1.0 - fallen, kPlaceAtTicks);
}

// The body rotates about its centre although its slider forbids that, so its anchor moves
// backwards. The slider takes the rotation and leaves the momentum, and friction has to stop the
// forward motion that is left: m v/f later. With and without a floor that is near, since groups of
// contacts decide by other equations.
TEST_P(EventList, FrictionOpposesTheMotionThatJointsLeave) {
  constexpr double kMass = 1.5, kSpeed = 1.0, kFriction = 2.0;
  for (const bool has_floor : {false, true}) {
    World world(by_events(GetParam(), 0.0));
    if (has_floor) world.add_body(make_floor(0.0));
    Body body = make_body("cart", Sphere{0.1}, kMass, {0.0, 0.0, 0.101});
    body.state.linear_velocity = {kSpeed, 0.0, 0.0};
    body.state.angular_velocity = {0.0, 0.0, 2.0 * kSpeed};
    const BodyId id = world.add_body(body);
    Joint joint = make_joint("slider", kWorldBody, {0.0, 1.0, 0.101}, id, {0.0, 1.0, 0.0},
                             JointKind::kSlider);
    joint.frame_a = frame_along(Vector3d::UnitX());
    joint.frame_b = joint.frame_a;
    joint.coordinates[0].friction = kFriction;
    world.add_joint(joint);
    std::vector<Event> events = events_of(&world, 1.0);
    events.erase(
        std::remove_if(events.begin(), events.end(),
                       [](const Event& event) { return event.kind != EventKind::kSticks; }),
        events.end());
    ASSERT_EQ(events.size(), 1u) << has_floor;
    EXPECT_NEAR(events[0].time, kMass * kSpeed / kFriction, kTimeAtTicks) << has_floor;
    EXPECT_NEAR(world.state(id).position.x(), 0.5 * kMass * kSpeed * kSpeed / kFriction,
                kPlaceAtTicks)
        << has_floor;
  }
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
  world.remove_joint(rod_id);  // the event refers to its id
  EXPECT_TRUE(world.events().empty());
}

}  // namespace
}  // namespace constraint_sim::engine
