// Contacts together with ropes, limits, friction and force-limited motors of joints, in one
// event-driven group. Oracles: closed forms. Errors are rounding, and the tolerance for rotating
// bodies.

#include "bouncing.h"
#include "by_events.h"
#include "pendulum.h"
#include "rotation_between.h"
#include "support.h"

namespace constraint_sim::engine {
namespace {

using Eigen::Vector3d;

/// Returns a slider along x from the world to a body.
Joint slider_along_x(BodyId body, const Vector3d& place) {
  Joint joint;
  joint.name = "slider";
  joint.kind = JointKind::kSlider;
  joint.anchor_a = place;
  joint.frame_a = rotation_between(Vector3d::UnitZ(), Vector3d::UnitX());
  joint.body_b = body;
  return joint;
}

class ContactsWithLawsAt : public testing::TestWithParam<Carried> {};

INSTANTIATE_TEST_SUITE_P(Ticks, ContactsWithLawsAt,
                         testing::ValuesIn(each_setting(Method::kEventDriven)));

// A bob on a taut rope swings from 60° against a wall below its pivot, as on a rod: the first
// impact is after a quarter of its period, with √(2 g L (1 − cos 60°)), and e of the speed after
// each.
TEST_P(ContactsWithLawsAt, ABobOnARopeHitsAWall) {
  constexpr double kRestitution = 0.8, kLength = 1.0, kRadius = 0.1;
  World world(by_events(GetParam()));
  world.add_body(plane("wall", {-kRadius, 0.0, 0.0}, Vector3d::UnitX(), 0.0, kRestitution));
  const double angle = kPi / 3.0;
  const BodyId bob = world.add_body(make_body(
      "bob", Sphere{kRadius}, 1.0, {kLength * std::sin(angle), 0.0, -kLength * std::cos(angle)}));
  const JointId id = world.add_joint(hang("rope", bob, rope(kLength)));
  std::vector<Event> events;
  double worst = 0.0;
  while (world.time() < 4.0 - 1e-9) {
    const std::vector<Event> now = advance(&world, GetParam());
    events.insert(events.end(), now.begin(), now.end());
    const double phi = thrown_back(angle, kRestitution, kLength, world.time());
    const Vector3d place = kLength * Vector3d(std::sin(phi), 0.0, -std::cos(phi));
    worst = std::max(worst, (world.state(bob).position - place).norm());
  }
  const std::vector<Event> hits = of_kind(events, EventKind::kContactBegan);
  EXPECT_LT(worst, 1.7e-11);  // a taut rope acts as a rod
  ASSERT_GE(hits.size(), 3u);
  EXPECT_NEAR(hits[0].time, time_of_fall(angle, 0.0, kLength), 1e-11);  // at 3 m/s
  double speed = std::sqrt(2.0 * kGravity * kLength * (1.0 - std::cos(angle)));
  for (const Event& event : hits) {
    EXPECT_NEAR(event.impulse, (1.0 + kRestitution) * speed, 1e-8);
    speed *= kRestitution;
  }
  EXPECT_NEAR(world.energy(), 0.5 * speed * speed - kGravity * kLength, 1e-8);
  EXPECT_LT(std::abs(world.joint_state(id).error), 1e-12);
  EXPECT_TRUE(of_kind(events, EventKind::kRopeSlack).empty());
}

// A ball between a wall, e = 0.5, and the end of its rope, which stops it, without gravity.
TEST_P(ContactsWithLawsAt, ARopeStopsWhatAWallThrowsBack) {
  World world(by_events(GetParam(), 0.0));
  world.add_body(plane("wall", {0.6, 0.0, 0.0}, -Vector3d::UnitX(), 0.3, 0.5));
  Body ball = make_body("ball", Sphere{0.1}, 2.0, Vector3d::Zero());
  ball.state.linear_velocity.x() = 4.0;
  const BodyId id = world.add_body(ball);
  world.add_joint(
      make_joint("rope", kWorldBody, {0.2, 0.0, 0.0}, id, Vector3d::Zero(), rope(0.45)));
  const std::vector<Event> events = advance(&world, 1.0);
  // 0.5 m at 4 m/s, back by 0.75 m at 2 m/s
  const std::vector<Event> hits = of_kind(events, EventKind::kContactBegan);
  const std::vector<Event> taut = of_kind(events, EventKind::kRopeTaut);
  ASSERT_EQ(hits.size(), 1u);
  EXPECT_NEAR(hits[0].time, 0.125, kTime);
  EXPECT_NEAR(hits[0].impulse, 2.0 * 6.0, kPlace);
  ASSERT_EQ(taut.size(), 1u);
  EXPECT_NEAR(taut[0].time, 0.5, kTime);
  EXPECT_NEAR(taut[0].impulse, 2.0 * 2.0, kPlace);
  EXPECT_NEAR(world.state(id).position.x(), -0.25, kPlace);
  EXPECT_LT(world.state(id).linear_velocity.norm(), 1e-14);
}

// A winch of 30 N pulls a box of 5 kg over a floor: with μ = 0.3 at (30 − μ m g)/m up to its target
// of 0.8 m/s, and then with μ m g; with μ = 0.7 not at all. By a rope that is wound, and by a motor
// on the length.
TEST_P(ContactsWithLawsAt, AWinchPullsABoxOverAFloor) {
  constexpr double kForce = 30.0, kMass = 5.0, kSpeed = 0.8;
  for (const bool by_rope : {true, false}) {
    for (const double mu : {0.3, 0.7}) {
      World world(by_events(GetParam()));
      world.add_body(plane("floor", Vector3d::Zero(), Vector3d::UnitZ(), mu, 0.0));
      const BodyId id = world.add_body(
          with_surface(make_body("box", Box{{0.6, 0.5, 0.4}}, kMass, {5.0, 0.0, 0.2}), mu, 0.0));
      Joint winch =
          make_joint("winch", kWorldBody, {0.0, 0.0, 0.2}, id, Vector3d::Zero(), rope(5.0));
      if (by_rope) {
        winch.motor.bias = -kSpeed;
        winch.motor.max_force = kForce;
      } else {
        winch.kind = JointKind::kFreeDistance;
        winch.distance = {};
        winch.coordinates[0].motor.emplace();
        winch.coordinates[0].motor->bias = -kSpeed;
        winch.coordinates[0].motor->max_force = kForce;
      }
      const JointId joint = world.add_joint(winch);
      const std::vector<Event> events = advance(&world, 1.0);
      const double friction = mu * kMass * kGravity;
      const double a = std::max(0.0, (kForce - friction) / kMass);
      const double t = a > 0.0 ? kSpeed / a : 0.0;
      const double displacement = a > 0.0 ? 0.5 * a * t * t + kSpeed * (world.time() - t) : 0.0;
      EXPECT_LT((world.state(id).position - Vector3d(5.0 - displacement, 0.0, 0.2)).norm(),
                10.0 * kPlace)
          << by_rope << ' ' << mu;
      EXPECT_NEAR(contact_force_on(world, id).z(), kMass * kGravity, 1e-9);
      EXPECT_NEAR(contact_force_on(world, id).x(), a > 0.0 ? friction : kForce, 1e-9);
      EXPECT_NEAR(std::abs(world.joint_state(joint).force), a > 0.0 ? friction : kForce, 1e-9);
      EXPECT_EQ(world.joint_state(joint).saturated, a == 0.0);
      if (a == 0.0) continue;
      const std::vector<Event> released = of_kind(events, EventKind::kReleased);
      ASSERT_EQ(released.size(), 1u);
      EXPECT_NEAR(released[0].time, t, kTime);
    }
  }
}

// A box on a spring slides over a floor: about ±μ m g/k alternately, until it sticks.
TEST_P(ContactsWithLawsAt, ABoxOnASpringSlidesOverAFloor) {
  constexpr double kMass = 2.0, kMu = 0.1, kStiffness = 40.0, kStart = 0.3;
  World world(by_events(GetParam()));
  world.add_body(plane("floor", Vector3d::Zero(), Vector3d::UnitZ(), kMu, 0.0));
  const BodyId id = world.add_body(
      with_surface(make_body("box", Box{{0.6, 0.5, 0.4}}, kMass, {kStart, 0.0, 0.2}), kMu, 0.0));
  world.add_joint(make_joint("spring", kWorldBody, {-1.0, 0.0, 0.2}, id, Vector3d::Zero(),
                             spring(1.0, kStiffness, 0.0)));
  const double omega = std::sqrt(kStiffness / kMass), shift = kMu * kMass * kGravity / kStiffness;
  const double half = kPi / omega;
  while (world.time() < 3.0 - 1e-9) {
    advance(&world, GetParam());
    double x = kStart, t = world.time();
    for (; t > half && std::abs(x) > shift; t -= half) x = (x > 0.0 ? 2.0 : -2.0) * shift - x;
    const double about = x > 0.0 ? shift : -shift;
    if (std::abs(x) > shift) x = about + (x - about) * std::cos(omega * t);
    // the tolerance of 1e-10 m/s over three seconds
    ASSERT_LT((world.state(id).position - Vector3d(x, 0.0, 0.2)).norm(), 3e-10) << world.time();
  }
  EXPECT_LT(world.state(id).linear_velocity.norm(), 1e-12);
}

// A ball bounces to rest on an arm held by its hinge's stop, as on a floor.
TEST_P(ContactsWithLawsAt, ABallBouncesOnAnArmAtItsStop) {
  for (const double e : {0.0, 0.5, 0.9}) {
    World world(by_events(GetParam()));
    const Body arm =
        with_surface(make_body("arm", Box{{1.0, 0.4, 0.2}}, 3.0, {0.5, 0.0, -0.1}), 0.0, e);
    const BodyId arm_id = world.add_body(arm);
    Joint hinge;
    hinge.name = "hinge";
    hinge.kind = JointKind::kHinge;
    hinge.anchor_a = {0.0, 0.0, -0.1};
    hinge.frame_a = rotation_between(Vector3d::UnitZ(), Vector3d::UnitY());
    hinge.body_b = arm_id;
    hinge.anchor_b = {-0.5, 0.0, 0.0};
    hinge.coordinates[0].upper = 0.0;  // turning about y lowers the arm
    const JointId joint = world.add_joint(hinge);
    const BodyId ball =
        world.add_body(with_surface(make_body("ball", Sphere{0.1}, 2.0, {0.7, 0.0, 0.4}), 0.0, e));
    std::size_t hits = 0;
    while (world.time() < (e == 0.9 ? 5.5 : 2.0) - 1e-9) {
      hits += of_kind(advance(&world, GetParam()), EventKind::kContactBegan).size();
      expect_bouncing(world.state(ball).position.z() - 0.1, 0.3, e, world.time());
    }
    // Bounces above 1e-10 m, from 0.3 m, and where they end after a step, some more of them.
    EXPECT_LE(hits, e == 0.9 ? 140u : 24u) << e;
    EXPECT_LT((world.state(arm_id).position - arm.state.position).norm(), kPlace);
    // 2 kg at 0.7 m and 3 kg at 0.5 m
    EXPECT_NEAR(world.joint_state(joint).coordinates[0].effort, -kGravity * (2.0 * 0.7 + 3.0 * 0.5),
                1e-8);
  }
}

// With a loose tolerance bounces are followed down to 1 % of the error that it allows in a step.
TEST(ContactsWithLaws, LowBouncesAreNotFollowedWithALooseTolerance) {
  constexpr double kStep = 0.1, kTolerance = 0.1, kLowest = 0.01 * kTolerance * kStep;
  WorldOptions options = by_events(kStep);
  options.tolerance = kTolerance;
  World world(options);
  const BodyId arm = world.add_body(
      with_surface(make_body("arm", Box{{1.0, 0.4, 0.2}}, 3.0, {0.5, 0.0, 2.0}), 0.0, 0.5));
  Joint slider;  // falls onto its own stop, e = 0.5
  slider.name = "slider";
  slider.kind = JointKind::kSlider;
  slider.body_b = arm;
  slider.anchor_a = {0.5, 0.0, 2.0};
  slider.coordinates[0].lower = -0.3;
  slider.coordinates[0].limit_restitution = 0.5;
  world.add_joint(slider);
  const BodyId ball =
      world.add_body(with_surface(make_body("ball", Sphere{0.1}, 2.0, {3.0, 0.0, 0.4}), 0.0, 0.5));
  world.add_body(plane("floor", {0.0, 0.0, 0.0}, Vector3d::UnitZ(), 0.0, 0.5));
  std::size_t hits = 0, stops = 0;
  double of_ball = 0.0, of_arm = 0.0;  // sums of estimated errors
  while (world.time() < 2.0 - 1e-9) {
    const std::vector<Event> events = advance(&world, kStep);
    of_ball += world.islands()[1].local_error;
    of_arm += world.islands()[0].local_error;
    hits += of_kind(events, EventKind::kContactBegan).size();
    stops += of_kind(events, EventKind::kLimitReached).size();
    const double height = bouncing(0.3, 0.5, world.time());
    EXPECT_NEAR(world.state(ball).position.z() - 0.1, height, kLowest) << world.time();
    EXPECT_NEAR(world.state(arm).position.z() - 1.7, height, kLowest) << world.time();
  }
  for (const double estimated : {of_ball, of_arm}) EXPECT_GE(estimated, kLowest);
  EXPECT_LE(hits, 8u);  // 0.3 · 0.25⁶ m is less than 1e-4 m
  EXPECT_LE(stops, 8u);
}

// A ball of m strikes a block of M on a slider with friction, e = 1: the block leaves with 2 m v/(m
// + M) and stops after V²/(2 f/M), the ball keeps (m − M) v/(m + M).
TEST_P(ContactsWithLawsAt, FrictionOfASliderStopsWhatABallStrikes) {
  constexpr double kBall = 1.0, kBlock = 3.0, kFriction = 5.0, kSpeed = 4.0;
  World world(by_events(GetParam(), 0.0));
  const BodyId block = world.add_body(
      with_surface(make_body("block", Box{{0.4, 0.4, 0.4}}, kBlock, {1.0, 0.0, 0.0}), 0.5, 1.0));
  Joint joint = slider_along_x(block, {1.0, 0.0, 0.0});
  joint.coordinates[0].friction = kFriction;
  world.add_joint(joint);
  Body ball = with_surface(make_body("ball", Sphere{0.1}, kBall, Vector3d::Zero()), 0.5, 1.0);
  ball.state.linear_velocity.x() = kSpeed;
  const BodyId ball_id = world.add_body(ball);
  const std::vector<Event> events = advance(&world, 2.0);
  const double hit = 0.7 / kSpeed, V = 2.0 * kBall * kSpeed / (kBall + kBlock);
  const double decelerates = kFriction / kBlock;
  EXPECT_NEAR(world.state(block).position.x(), 1.0 + 0.5 * V * V / decelerates, kPlace);
  EXPECT_NEAR(world.state(ball_id).position.x(),
              0.7 + (kBall - kBlock) / (kBall + kBlock) * kSpeed * (world.time() - hit), kPlace);
  const std::vector<Event> sticks = of_kind(events, EventKind::kSticks);
  ASSERT_EQ(sticks.size(), 1u);
  EXPECT_NEAR(sticks[0].time, hit + V / decelerates, 1e-11);
}

// A motor of 12 N drives a ball of 2 kg on a slider against a wall, e = 0: there the wall carries
// the full force, and the motor is at its limit.
TEST_P(ContactsWithLawsAt, AMotorDrivesABallAgainstAWall) {
  World world(by_events(GetParam(), 0.0));
  world.add_body(plane("wall", {1.0, 0.0, 0.0}, -Vector3d::UnitX(), 0.0, 0.0));
  const BodyId ball = world.add_body(make_body("ball", Sphere{0.1}, 2.0, Vector3d::Zero()));
  Joint joint = slider_along_x(ball, Vector3d::Zero());
  joint.coordinates[0].motor.emplace();
  joint.coordinates[0].motor->bias = 2.0;
  joint.coordinates[0].motor->max_force = 12.0;
  const JointId id = world.add_joint(joint);
  const std::vector<Event> events = advance(&world, 1.0);
  // at 6 m/s² to 2 m/s in 1/3 s and 1/3 m, then 0.9 − 1/3 m at that speed
  const std::vector<Event> hits = of_kind(events, EventKind::kContactBegan);
  ASSERT_EQ(hits.size(), 1u);
  EXPECT_NEAR(hits[0].time, 1.0 / 3.0 + (0.9 - 1.0 / 3.0) / 2.0, kTime);
  EXPECT_NEAR(hits[0].impulse, 4.0, 1e-11);
  EXPECT_NEAR(world.state(ball).position.x(), 0.9, kPlace);
  EXPECT_NEAR(contact_force_on(world, ball).x(), -12.0, 1e-9);
  EXPECT_TRUE(world.joint_state(id).saturated);
  EXPECT_NEAR(world.joint_state(id).coordinates[0].effort, 12.0, 1e-9);
}

// The ball on a cylindrical joint, which a second motor turns at 0.5 rad/s with 0.08 N m:
// saturation is reported for each motor separately.
TEST_P(ContactsWithLawsAt, MotorsOfOneJointAreToldApart) {
  World world(by_events(GetParam(), 0.0));
  world.add_body(plane("wall", {1.0, 0.0, 0.0}, -Vector3d::UnitX(), 0.0, 0.0));
  const BodyId ball = world.add_body(make_body("ball", Sphere{0.1}, 2.0, Vector3d::Zero()));
  Joint joint = slider_along_x(ball, Vector3d::Zero());
  joint.kind = JointKind::kCylindrical;
  joint.frame_b = joint.frame_a;
  const std::array<std::pair<double, double>, 2> motors{{{2.0, 12.0}, {0.5, 0.08}}};
  for (std::size_t i = 0; i < motors.size(); ++i) {
    joint.coordinates[i].motor.emplace();
    joint.coordinates[i].motor->bias = motors[i].first;
    joint.coordinates[i].motor->max_force = motors[i].second;
  }
  const JointId id = world.add_joint(joint);
  std::vector<Event> told;
  for (const Event& event : advance(&world, 1.0))
    if (event.joint) told.push_back(event);
  // 2/5 m r² accelerated by 0.08 N m
  ASSERT_EQ(told.size(), 3u);
  EXPECT_EQ(told[0].kind, EventKind::kReleased);
  EXPECT_EQ(told[0].coordinate, 1);
  EXPECT_NEAR(told[0].time, 0.5 * 0.4 * 2.0 * 0.01 / 0.08, kTime);
  EXPECT_EQ(told[1].kind, EventKind::kReleased);
  EXPECT_EQ(told[1].coordinate, 0);
  EXPECT_NEAR(told[1].time, 1.0 / 3.0, kTime);
  EXPECT_EQ(told[2].kind, EventKind::kSaturated);
  EXPECT_EQ(told[2].coordinate, 0);
  EXPECT_NEAR(told[2].time, 1.0 / 3.0 + (0.9 - 1.0 / 3.0) / 2.0, kTime);
  EXPECT_TRUE(world.joint_state(id).saturated);
}

// A servo of 20 N/m about 1.2 m and 12 N drives a ball of 2 kg on a slider against a wall, e = 0:
// at its limit up to 0.6 m, then with its spring, and the wall carries the remaining force.
TEST_P(ContactsWithLawsAt, AServoDrivesABallAgainstAWall) {
  constexpr double kStiffness = 20.0, kForce = 12.0, kMass = 2.0;
  World world(by_events(GetParam(), 0.0));
  world.add_body(plane("wall", {1.0, 0.0, 0.0}, -Vector3d::UnitX(), 0.0, 0.0));
  const BodyId ball = world.add_body(make_body("ball", Sphere{0.1}, kMass, Vector3d::Zero()));
  Joint joint = slider_along_x(ball, Vector3d::Zero());
  joint.coordinates[0].motor.emplace();
  joint.coordinates[0].motor->position = 1.2;
  joint.coordinates[0].motor->servo_stiffness = kStiffness;
  joint.coordinates[0].motor->max_force = kForce;
  const JointId id = world.add_joint(joint);
  const std::vector<Event> events = advance(&world, 1.5);
  const double a = kForce / kMass, released = std::sqrt(2.0 * 0.6 / a), v = a * released;
  const double omega = std::sqrt(kStiffness / kMass), reach = std::hypot(0.6, v / omega);
  const double hit = released + (std::asin(-0.3 / reach) - std::asin(-0.6 / reach)) / omega;
  const std::vector<Event> hits = of_kind(events, EventKind::kContactBegan);
  const std::vector<Event> let_go = of_kind(events, EventKind::kReleased);
  ASSERT_EQ(let_go.size(), 1u);
  EXPECT_NEAR(let_go[0].time, released, 1e-11);
  ASSERT_EQ(hits.size(), 1u);
  EXPECT_NEAR(hits[0].time, hit, 1e-9);
  EXPECT_NEAR(hits[0].impulse, kMass * omega * std::sqrt(reach * reach - 0.09), 1e-8);
  EXPECT_NEAR(world.state(ball).position.x(), 0.9, kPlace);
  EXPECT_NEAR(contact_force_on(world, ball).x(), -0.3 * kStiffness, 1e-9);
  EXPECT_FALSE(world.joint_state(id).saturated);
}

// A ball pushes a block off the position that its motor holds: the motor stops it, returns it with
// its full force, and the block ends at rest in its place.
TEST_P(ContactsWithLawsAt, AMotorBringsBackWhatABallStruck) {
  constexpr double kForce = 5.0, kBall = 1.0, kBlock = 2.0, kSpeed = 2.0;
  World world(by_events(GetParam(), 0.0));
  const BodyId block = world.add_body(
      with_surface(make_body("block", Box{{0.4, 0.4, 0.4}}, kBlock, {1.0, 0.0, 0.0}), 0.0, 1.0));
  Body ball = with_surface(make_body("ball", Sphere{0.1}, kBall, Vector3d::Zero()), 0.0, 1.0);
  ball.state.linear_velocity.x() = kSpeed;
  world.add_body(ball);
  Joint joint = slider_along_x(block, {1.0, 0.0, 0.0});
  joint.coordinates[0].motor.emplace();
  joint.coordinates[0].motor->position = 0.0;
  joint.coordinates[0].motor->max_force = kForce;
  world.add_joint(joint);
  const double hit = 0.7 / kSpeed, v = 2.0 * kBall * kSpeed / (kBall + kBlock);
  const double a = kForce / kBlock, b = 0.5 * a, turns = hit + v / a, furthest = 0.5 * v * v / a;
  const double brakes = turns + std::sqrt(2.0 * furthest / 3.0 / a);
  const double rests = brakes + std::sqrt(2.0 * 2.0 * furthest / 3.0 / b);
  std::vector<Event> released;
  while (world.time() < 3.0) {
    world.step();
    for (const Event& event : world.events())
      if (event.kind == EventKind::kReleased) released.push_back(event);
    const double t = world.time(), after = t - turns, left = rests - t;
    const double x = t < hit      ? 0.0
                     : t < brakes ? furthest - 0.5 * a * after * after
                     : t < rests  ? 0.5 * b * left * left
                                  : 0.0;
    ASSERT_NEAR(world.state(block).position.x() - 1.0, x, 1e-10) << t;
  }
  ASSERT_EQ(released.size(), 1u);
  EXPECT_NEAR(released[0].time, brakes, 1e-10);
}

// A motor without a force limit acts like a wall.
TEST_P(ContactsWithLawsAt, AMotorOfAnyForceHoldsABlockThatABallStrikes) {
  World world(by_events(GetParam(), 0.0));
  const BodyId block = world.add_body(
      with_surface(make_body("block", Box{{0.4, 0.4, 0.4}}, 2.0, {1.0, 0.0, 0.0}), 0.0, 1.0));
  Body ball = with_surface(make_body("ball", Sphere{0.1}, 1.0, Vector3d::Zero()), 0.0, 1.0);
  ball.state.linear_velocity.x() = 2.0;
  const BodyId id = world.add_body(ball);
  Joint joint = slider_along_x(block, {1.0, 0.0, 0.0});
  joint.coordinates[0].motor.emplace();
  joint.coordinates[0].motor->position = 0.0;
  world.add_joint(joint);
  advance(&world, 1.0);
  EXPECT_NEAR(world.state(block).position.x(), 1.0, kPlace);
  EXPECT_NEAR(world.state(id).position.x(), 0.7 - 2.0 * (world.time() - 0.35), kPlace);
}

// A slider's stop and a wall reached at the same time share one force, which is determined only in
// sum and by its bounds.
TEST_P(ContactsWithLawsAt, AStopAndAWallShareAForce) {
  World world(by_events(GetParam(), 0.0));
  world.add_body(plane("wall", {1.0, 0.0, 0.0}, -Vector3d::UnitX(), 0.0, 0.0));
  Body ball = make_body("ball", Sphere{0.1}, 2.0, Vector3d::Zero());
  ball.state.linear_velocity.x() = 3.0;
  const BodyId id = world.add_body(ball);
  Joint joint = slider_along_x(id, Vector3d::Zero());
  joint.coordinates[0].upper = 0.9;
  const JointId slider = world.add_joint(joint);
  Wrench push;
  push.body = id;
  push.force = {7.0, 0.0, 0.0};
  world.add_wrench(push);
  advance(&world, 1.0);
  EXPECT_NEAR(world.state(id).position.x(), 0.9, kPlace);
  const double stop = -world.joint_state(slider).coordinates[0].effort;
  const double wall = -contact_force_on(world, id).x();
  EXPECT_GE(stop, -1e-9);
  EXPECT_GE(wall, -1e-9);
  EXPECT_NEAR(stop + wall, 7.0, 1e-9);
}

// A slack rope changes nothing: the ball bounces as without it.
TEST_P(ContactsWithLawsAt, ASlackRopeChangesNothing) {
  World with(by_events(GetParam())), without(by_events(GetParam()));
  BodyId id;
  for (World* of : {&with, &without}) {
    of->add_body(plane("floor", Vector3d::Zero(), Vector3d::UnitZ(), 0.3, 0.8));
    Body ball = with_surface(make_body("ball", Sphere{0.1}, 2.0, {0.0, 0.0, 0.5}), 0.3, 0.8);
    ball.state.linear_velocity = {0.3, 0.0, 0.0};
    id = of->add_body(ball);
  }
  with.add_joint(hang("rope", id, rope(5.0)));
  advance(&with, 1.5);
  advance(&without, 1.5);
  EXPECT_LT((with.state(id).position - without.state(id).position).norm(), 1e-12);
  EXPECT_LT((with.state(id).angular_velocity - without.state(id).angular_velocity).norm(), 1e-11);
}

// Cost of an event beyond the substep of an undisturbed tick, at a tick that needs only one: at
// most five substeps, including those repeated to find the event.
TEST(ContactsWithLaws, AnEventCostsAtMostFiveSubsteps) {
  for (const bool on_rope : {false, true}) {
    World world(by_events(1.0 / 240));
    if (on_rope) {
      world.add_body(plane("wall", {-0.1, 0.0, 0.0}, Vector3d::UnitX(), 0.0, 1.0));
      const BodyId bob =
          world.add_body(make_body("bob", Sphere{0.1}, 1.0, {std::sin(0.5), 0.0, -std::cos(0.5)}));
      world.add_joint(hang("rope", bob, rope(1.0)));
    } else {
      world.add_body(plane("floor", Vector3d::Zero(), Vector3d::UnitZ(), 0.3, 1.0));
      world.add_body(with_surface(make_body("ball", Sphere{0.1}, 2.0, {0.0, 0.0, 0.3}), 0.3, 1.0));
    }
    int substeps = 0, events = 0, ticks = 0;
    for (; ticks < 2400; ++ticks) {
      const StepReport& report = world.step();
      substeps += static_cast<int>(report.costs.substeps + report.costs.rejected);
      events += static_cast<int>(report.costs.events);
    }
    ASSERT_GT(events, 5) << on_rope;
    EXPECT_LE(substeps - ticks, 5 * events) << on_rope;
  }
}

// A ball on a floor, or on a slider with a stop, bounces more than ten times in a tick. An
// island that may take 15 substeps and events is given up, with the reason.
TEST(ContactsWithLaws, AStepTakesNoMoreThanItsWork) {
  for (const bool has_floor : {true, false}) {
    for (const double work : {15.0, WorldOptions{}.event_work, kInfinity}) {
      WorldOptions options = by_events(8.0);
      options.event_work = work;
      options.sleep_after = kInfinity;  // the reason of an island at rest is another one
      World world(options);
      if (has_floor) world.add_body(make_floor(0.0));
      const BodyId ball =
          world.add_body(with_surface(make_body("ball", Sphere{0.1}, 1.0, {0, 0, 0.3}), 0.0, 0.95));
      Joint slider;
      slider.name = "slider";
      slider.kind = JointKind::kSlider;
      slider.anchor_a = {0, 0, 0.3};
      slider.body_b = ball;
      slider.coordinates[0].lower = -0.2;
      slider.coordinates[0].limit_restitution = 0.95;
      if (!has_floor) world.add_joint(slider);
      const StepReport& report = world.step();
      const Island island = world.islands()[0];
      const bool is_given_up = work < 100.0;
      EXPECT_EQ(uses_impulses(island.method), is_given_up) << has_floor << " " << work;
      if (is_given_up) {
        EXPECT_EQ(island.why, has_floor ? MethodReason::kContactsGivenUp : MethodReason::kRefused);
      } else {
        EXPECT_GT(report.costs.events, 10u);
      }
    }
  }
}

// A position motor whose coordinate a motor without force limit moves has no deceleration of its
// own, also after a ball has hit the cart. The deceleration is the response of the coordinate to
// the motor, which is zero but for rounding; a rounding would count as a motor that brakes, at some
// masses but not at others.
TEST(ContactsWithLaws, AMotorThatAnotherOneMovesHasNoDeceleration) {
  for (const double mass : {2.0, 3.3}) {
    World world(by_events(0.1));
    Body cart = make_body("cart", Box{{0.4, 0.4, 0.2}}, mass, Vector3d::Zero());
    cart.state.linear_velocity.x() = 0.5;
    const BodyId id = world.add_body(with_surface(cart, 0.0, 0.5));
    Joint goal = slider_along_x(id, Vector3d::Zero()), drive = goal;
    goal.coordinates[0].motor.emplace();
    goal.coordinates[0].motor->position = 0.0;
    goal.coordinates[0].motor->max_force = 50.0;
    drive.name = "drive";
    drive.coordinates[0].motor.emplace();
    drive.coordinates[0].motor->bias = 0.5;
    const JointId motor = world.add_joint(goal);
    world.add_joint(drive);
    Body ball = make_body("ball", Sphere{0.1}, 1.0, {0.05, 0.0, 0.25});
    ball.state.linear_velocity.z() = -1.0;
    world.add_body(with_surface(ball, 0.0, 0.5));
    world.step();
    EXPECT_GT(world.report().costs.events, 0u);
    EXPECT_EQ(world.joint_state(motor).coordinates[0].braking, 0.0) << mass;
  }
}

}  // namespace
}  // namespace constraint_sim::engine
