// Event-driven contacts with moving bodies: conveyors, lifts, turntables and walls. Oracles: closed
// forms, and the energy less the work of the moving bodies.

#include "by_events.h"
#include "support.h"

namespace constraint_sim::engine {
namespace {

using Eigen::AngleAxisd;
using Eigen::Quaterniond;
using Eigen::Vector3d;

constexpr double kCarriedMass = 2.0;

class MovingContactsAt : public testing::TestWithParam<Carried> {};

INSTANTIATE_TEST_SUITE_P(Ticks, MovingContactsAt,
                         testing::ValuesIn(each_setting(Method::kEventDriven)));
INSTANTIATE_TEST_SUITE_P(Poses, MovingContactsAt, testing::ValuesIn(with_poses()));
INSTANTIATE_TEST_SUITE_P(Parts, MovingContactsAt, testing::ValuesIn(with_parts()));

Body mover(const Vector3d& size, const Vector3d& position, const Vector3d& velocity) {
  Body body = make_body("mover", Box{size}, 0.0, position);
  body.type = BodyType::kKinematic;
  body.state.linear_velocity = velocity;
  return body;
}

struct Told {
  std::vector<Event> events;
  double driven = 0.0;  ///< work [J]
};

Told go_on(World* world, double seconds) {
  Told told;
  const int steps = static_cast<int>(std::lround(seconds / world->options().time_step));
  for (int i = 0; i < steps; ++i) {
    const std::vector<Event> now = advance(world, world->options().time_step);
    told.events.insert(told.events.end(), now.begin(), now.end());
    told.driven += world->report().energy.driven_work;
    EXPECT_EQ(world->report().energy.rise, 0.0) << world->time();
  }
  return told;
}

// The box accelerates with μ g to the belt's speed, in the time V/μ g; the belt does m V² of work,
// half of it heat.
TEST_P(MovingContactsAt, ABoxOnAConveyorIsCarriedAlong) {
  constexpr double kMu = 0.3, kSpeed = 1.2;
  World world(by_events(GetParam()));
  world.add_body(
      with_surface(mover({20.0, 2.0, 0.2}, {0.0, 0.0, -0.1}, {kSpeed, 0.0, 0.0}), kMu, 0));
  const BodyId id = world.add_body(with_surface(
      make_body("box", Box{{0.4, 0.3, 0.2}}, kCarriedMass, {0.0, 0.0, 0.1}), kMu, 0.0));
  frame_anew(&world, GetParam());
  const double before = world.energy(), sticks = kSpeed / (kMu * kGravity);
  const Told told = go_on(&world, 1.0);
  const double x = kSpeed * (world.time() - 0.5 * sticks);
  EXPECT_LT((world.state(id).position - Vector3d(x, 0.0, 0.1)).norm(), kPlace);
  EXPECT_LT((world.state(id).linear_velocity - Vector3d(kSpeed, 0.0, 0.0)).norm(), kPlace);
  ASSERT_EQ(told.events.size(), 1u);
  EXPECT_EQ(told.events[0].kind, EventKind::kSticks);
  EXPECT_NEAR(told.events[0].time, sticks, kTime);
  EXPECT_NEAR(told.driven, kCarriedMass * kSpeed * kSpeed, 1e-11);
  EXPECT_NEAR(world.energy() - before, 0.5 * kCarriedMass * kSpeed * kSpeed, 1e-11);
}

// The lift's power is m g v.
TEST_P(MovingContactsAt, ALiftCarriesABoxWithoutAnEvent) {
  constexpr double kSpeed = 0.7;
  World world(by_events(GetParam()));
  world.add_body(
      with_surface(mover({2.0, 2.0, 0.2}, {0.0, 0.0, -0.1}, {0.2, 0.0, kSpeed}), 0.5, 0));
  Body box =
      with_surface(make_body("box", Box{{0.4, 0.3, 0.2}}, kCarriedMass, {0.0, 0.0, 0.1}), 0.5, 0.0);
  box.state.linear_velocity = {0.2, 0.0, kSpeed};
  const BodyId id = world.add_body(box);
  frame_anew(&world, GetParam());
  const double before = world.energy();
  const Told told = go_on(&world, 1.0);
  EXPECT_TRUE(told.events.empty());
  const double t = world.time();
  EXPECT_LT((world.state(id).position - Vector3d(0.2 * t, 0.0, 0.1 + kSpeed * t)).norm(), kPlace);
  EXPECT_NEAR(told.driven, kCarriedMass * kGravity * kSpeed * t, 1e-10);
  EXPECT_NEAR(world.energy() - before, told.driven, 1e-10);
  EXPECT_EQ(world.contacts().size(), 4u);
}

// v⁺ = V − e (v − V), and the wall does V times the impulse.
TEST_P(MovingContactsAt, AWallHitsABall) {
  constexpr double kWall = -3.0, kBall = 1.0, kGap = 0.9;
  for (const double e : {0.0, 0.6, 1.0}) {
    World world(by_events(GetParam(), 0.0));
    world.add_body(
        with_surface(mover({0.2, 4.0, 4.0}, {0.2 + kGap, 0.0, 0.0}, {kWall, 0.0, 0.0}), 0.2, e));
    Body ball =
        with_surface(make_body("ball", Sphere{0.1}, kCarriedMass, Vector3d::Zero()), 0.2, e);
    ball.state.linear_velocity.x() = kBall;
    const BodyId id = world.add_body(ball);
    frame_anew(&world, GetParam());
    const Told told = go_on(&world, 0.5);
    const double hits = kGap / (kBall - kWall), after = kWall - e * (kBall - kWall);
    const double x = kBall * hits + after * (world.time() - hits);
    EXPECT_NEAR(world.state(id).position.x(), x, kPlace) << e;
    EXPECT_NEAR(world.state(id).linear_velocity.x(), after, kPlace) << e;
    ASSERT_GE(told.events.size(), 1u);
    EXPECT_EQ(told.events[0].kind, EventKind::kContactBegan);
    EXPECT_NEAR(told.events[0].time, hits, kTime) << e;
    EXPECT_NEAR(told.events[0].impulse, kCarriedMass * (kBall - after), kPlace) << e;
    EXPECT_NEAR(told.driven, kWall * kCarriedMass * (after - kBall), 1e-11) << e;
  }
}

// A cube sticks to a turntable that also translates: it circles the table's centre. A zero wrench
// that starts within a tick splits the tick.
TEST_P(MovingContactsAt, ATurntableTakesABoxRound) {
  constexpr double kTurn = 2.0, kArm = 0.6;
  World world(by_events(GetParam()));
  Body table = mover({3.0, 3.0, 0.2}, {0.1, 0.0, -0.1}, {0.0, kTurn * 0.1, 0.0});
  table.state.angular_velocity.z() = kTurn;
  world.add_body(with_surface(table, 0.5, 0.0));
  Body box = with_surface(make_body("box", Box{{0.2, 0.2, 0.2}}, kCarriedMass, {kArm, 0.0, 0.1}),
                          0.5, 0.0);
  box.state.linear_velocity.y() = kTurn * kArm;  // v + ω (R − 0.1)
  box.state.angular_velocity.z() = kTurn;
  const BodyId id = world.add_body(box);
  frame_anew(&world, GetParam());
  const double v = kTurn * 0.1;
  Wrench none;
  none.body = id;
  none.start = 0.3 + 0.4 * GetParam();
  world.add_wrench(none);
  double worst = 0.0;
  while (world.time() < 1.0 - 1e-9) {
    go_on(&world, GetParam());
    const double t = world.time();
    const Vector3d centre(0.1, v * t, 0.0);
    const Vector3d place =
        centre + AngleAxisd(kTurn * t, Vector3d::UnitZ()) * Vector3d(kArm - 0.1, 0.0, 0.1);
    worst = std::max(worst, (world.state(id).position - place).norm());
  }
  EXPECT_LT(worst, 1e-9);  // error by the tolerance in a second
  EXPECT_EQ(world.contacts().size(), 4u);
}

// A bob on a rod from a trolley that drives it against a wall: in the trolley's frame a pendulum
// with an approaching wall.
TEST_P(MovingContactsAt, ABobOnATrolleyMeetsAWall) {
  constexpr double kSpeed = 0.8, kGap = 0.4, kRadius = 0.1;
  World world(by_events(GetParam()));
  Body wall = make_body("wall", Box{{1.0, 2.0, 4.0}}, 1.0, {0.5 + kRadius + kGap, 0.0, 0.0});
  wall.type = BodyType::kStatic;
  world.add_body(with_surface(wall, 0.0, 1.0));
  Body trolley = mover({0.1, 0.1, 0.1}, {0.0, 0.0, 0.0}, {kSpeed, 0.0, 0.0});
  trolley.no_collision = true;
  const BodyId drives = world.add_body(trolley);
  Body bob = make_body("bob", Sphere{kRadius}, 1.0, {0.0, 0.0, -1.0});
  bob.state.linear_velocity.x() = kSpeed;
  const BodyId id = world.add_body(bob);
  world.add_joint(make_joint("rod", drives, Vector3d::Zero(), id, Vector3d::Zero(), rod(1.0)));
  const Told told = go_on(&world, 0.9);
  ASSERT_GE(told.events.size(), 1u);
  EXPECT_NEAR(told.events[0].time, kGap / kSpeed, kTime);
  EXPECT_NEAR(told.events[0].impulse, 2.0 * kSpeed, 1e-10);
  // −2 V in the trolley's frame: 2 V² = g (1 − cos θ) + ½ θ̇²
  const Vector3d d = world.state(id).position - world.state(drives).position;
  const Vector3d u = world.state(id).linear_velocity - Vector3d(kSpeed, 0.0, 0.0);
  EXPECT_NEAR(0.5 * u.squaredNorm() + kGravity * (1.0 + d.z()), 2.0 * kSpeed * kSpeed, 1e-8);
}

}  // namespace
}  // namespace constraint_sim::engine
