// Events on coordinates: ropes, limits, force-limited motors, friction and breaking joints, and
// elements that do not act. Oracles: closed forms of the motion before and after each event, and
// the motion without inactive elements. Times are correct to 1e-9 s and positions to 1e-8 m at any
// tick, with tolerances of 1e-10 m/s and the default.

#include "bars_on_hinges.h"
#include "bouncing.h"
#include "by_events.h"
#include "constraint_sim/engine/plan.h"
#include "engine/math/list.h"
#include "pendulum.h"
#include "problems.h"
#include "rotation_between.h"
#include "support.h"

namespace constraint_sim::engine {
namespace {

using Eigen::Vector3d;

Body small_ball(const std::string& name, double mass, const Vector3d& position) {
  return make_body(name, Sphere{0.1}, mass, position);
}

/// Returns a slider of the world along z.
Joint slider_along_z(BodyId body, const CoordinateLaw& law) {
  Joint joint = make_joint("slider", kWorldBody, Vector3d::Zero(), body, Vector3d::Zero(),
                           JointKind::kSlider);
  joint.coordinates[0] = law;
  return joint;
}

const Island& only(const std::vector<Island>& islands) { return islands.front(); }

class AtTicks : public testing::TestWithParam<Carried> {};

INSTANTIATE_TEST_SUITE_P(Events, AtTicks, testing::ValuesIn(each_setting(Method::kAuto)));

// ---- inactive elements

/// Steps both worlds for a duration: the same substeps without an event, and the same bits.
void expect_same_bits(World* alone, World* beside, const std::string& body, double seconds) {
  while (alone->time() < seconds) {
    alone->step();
    beside->step();
    ASSERT_EQ(beside->report().costs.events, 0u) << beside->time();
    ASSERT_EQ(beside->report().costs.substeps, alone->report().costs.substeps) << beside->time();
    ASSERT_EQ(beside->report().costs.rejected, alone->report().costs.rejected) << beside->time();
    const BodyState& one = alone->state(alone->find_body(body));
    const BodyState& other = beside->state(beside->find_body(body));
    ASSERT_EQ(one.position, other.position) << beside->time();
    ASSERT_EQ(one.orientation.coeffs(), other.orientation.coeffs()) << beside->time();
    ASSERT_EQ(one.linear_velocity, other.linear_velocity) << beside->time();
    ASSERT_EQ(one.angular_velocity, other.angular_velocity) << beside->time();
  }
}

TEST_P(AtTicks, APendulumBesideASlackRopeIsThePendulum) {
  World alone(by_events(GetParam())), beside(by_events(GetParam()));
  for (World* world : {&alone, &beside}) {
    const BodyId bob = world->add_body(small_ball("bob", 1.0, {1.0, 0.0, 0.0}));
    world->add_joint(hang("rod", bob, rod(1.0)));
    if (world == &beside)
      world->add_joint(
          make_joint("rope", kWorldBody, {0.0, 0.5, 0.0}, bob, Vector3d::Zero(), rope(2.0)));
  }
  EXPECT_EQ(only(beside.islands()).method, Method::kEventDriven);
  expect_same_bits(&alone, &beside, "bob", 2.0);
}

/// A bar on a hinge at its end that rotates at a rate, with a law.
void hang_bar(World* world, double rate, const CoordinateLaw& law) {
  Body bar = make_body("bar", Box{{1.0, 0.1, 0.1}}, 2.0, {0.5, 0.0, 0.0});
  bar.state.angular_velocity.y() = rate;
  bar.state.linear_velocity.z() = -0.5 * rate;
  Joint hinge;
  hinge.name = "hinge";
  hinge.kind = JointKind::kHinge;
  hinge.frame_a = rotation_between(Vector3d::UnitZ(), Vector3d::UnitY());
  hinge.body_b = world->add_body(bar);
  hinge.anchor_b = {-0.5, 0.0, 0.0};
  hinge.coordinates[0] = law;
  world->add_joint(hinge);
}

// A bar with limits out of reach, or with a motor within its force limit.
TEST_P(AtTicks, ABarIsTheSameWithLimitsThatItIsOffAndWithAMotorBelowItsLimit) {
  for (const bool has_motor : {false, true}) {
    World alone(by_events(GetParam())), beside(by_events(GetParam()));
    CoordinateLaw law;
    if (has_motor) {
      law.motor.emplace();
      law.motor->bias = 0.5;
    }
    hang_bar(&alone, 0.5, law);
    if (has_motor) {
      law.motor->max_force = 1e3;
    } else {
      law.lower = -3.0;
      law.upper = 3.5;
    }
    hang_bar(&beside, 0.5, law);
    EXPECT_EQ(only(alone.islands()).method, Method::kRungeKutta);
    EXPECT_EQ(only(beside.islands()).method, Method::kEventDriven);
    expect_same_bits(&alone, &beside, "bar", 2.0);
  }
}

// A floor out of reach within a tick does not affect a pendulum; a nearer one is in a group with
// it, whose equations are the same in another order.
TEST_P(AtTicks, APendulumAboveAFloorThatItDoesNotTouchIsThePendulum) {
  for (const double floor : {-1.5, -1.11}) {
    World alone(by_events(GetParam())), beside(by_events(GetParam()));
    for (World* world : {&alone, &beside}) {
      const BodyId bob = world->add_body(small_ball("bob", 1.0, {1.0, 0.0, 0.0}));
      world->add_joint(hang("rod", bob, rod(1.0)));
    }
    beside.add_body(plane("floor", {0.0, 0.0, floor}, Vector3d::UnitZ(), 0.5, 0.0));
    if (floor == -1.5) {
      expect_same_bits(&alone, &beside, "bob", 2.0);
      continue;
    }
    double worst = 0.0;
    while (alone.time() < 2.0) {
      alone.step();
      beside.step();
      ASSERT_EQ(beside.report().costs.events, 0u) << beside.time();
      const Vector3d& place = alone.state(alone.find_body("bob")).position;
      worst = std::max(worst, (beside.state(beside.find_body("bob")).position - place).norm());
    }
    EXPECT_LT(worst, 5e-12);  // error by the tolerance with substeps of 1/30 s; else rounding
  }
}

// A ball falls until its rope is taut, and hangs.
TEST_P(AtTicks, ABallFallsIntoItsRope) {
  World world(by_events(GetParam()));
  const BodyId id = world.add_body(small_ball("ball", 2.0, {0.0, 0.0, -0.3}));
  const JointId rope_id = world.add_joint(hang("rope", id, rope(1.0)));
  const double taut = std::sqrt(2.0 * 0.7 / kGravity);
  std::uint32_t events = 0;
  for (int i = 0; i * GetParam() < 1.0; ++i) {
    world.step();
    events += world.report().costs.events;
    const double t = world.time();
    const double z = t < taut ? -0.3 - 0.5 * kGravity * t * t : -1.0;
    ASSERT_NEAR(world.state(id).position.z(), z, kPlaceAtTicks) << t;
    ASSERT_NEAR(world.state(id).linear_velocity.z(), t < taut ? -kGravity * t : 0.0, kPlaceAtTicks)
        << t;
    if (t - GetParam() > taut) {
      ASSERT_NEAR(world.joint_state(rope_id).force, -2.0 * kGravity, 1e-9);
    }
  }
  EXPECT_EQ(events, 1u);
}

// The ball keeps the velocity across the rope; from then on it is a pendulum.
TEST_P(AtTicks, ABallThrownSidewaysSwingsOnItsRope) {
  World world(by_events(GetParam()));
  const BodyId id = world.add_body(small_ball("ball", 2.0, {0.6, 0.0, 0.0}));
  world.add_joint(hang("rope", id, rope(1.0)));
  const double taut = std::sqrt(2.0 * 0.8 / kGravity);
  // starts from the exact state when the rope is taut
  World pendulum(by_events(Carried{1e-3, Method::kAuto}));
  const BodyId bob = pendulum.add_body(small_ball("bob", 2.0, {0.6, 0.0, -0.8}));
  pendulum.add_joint(hang("rod", bob, rod(1.0)));
  BodyState state = pendulum.state(bob);
  const Vector3d n(0.6, 0.0, -0.8), v(0.0, 0.0, -kGravity * taut);
  state.linear_velocity = v - n.dot(v) * n;
  pendulum.set_state(bob, state);
  const int steps = static_cast<int>(std::lround(0.8 / GetParam()));
  run(world, steps);
  // same end time; the last part of a tick is a separate tick
  const int whole = static_cast<int>((world.time() - taut) * 1000.0);
  run(pendulum, whole);
  WorldOptions options = pendulum.options();
  options.time_step = world.time() - taut - pendulum.time();
  pendulum.set_options(options);
  run(pendulum, 1);
  EXPECT_LT((world.state(id).position - pendulum.state(bob).position).norm(), kPlaceAtTicks);
  EXPECT_LT((world.state(id).linear_velocity - pendulum.state(bob).linear_velocity).norm(), 1e-7);
}

TEST_P(AtTicks, AStopIsHitWithItsRestitution) {
  for (const double e : {0.0, 0.5, 0.9, 1.0}) {
    World world(by_events(GetParam()));
    const BodyId id = world.add_body(small_ball("ball", 3.0, {0.0, 0.0, 0.5}));
    CoordinateLaw law;
    law.lower = 0.0;
    law.limit_restitution = e;
    world.add_joint(slider_along_z(id, law));
    EXPECT_EQ(only(world.islands()).why, MethodReason::kLimit);
    const double seconds = e == 0.9 ? 6.5 : 2.0;  // at rest after 6.07 s
    double worst = 0.0;
    for (int i = 0; i * GetParam() < seconds; ++i) {
      world.step();
      ASSERT_EQ(only(world.islands()).method, Method::kEventDriven);
      worst =
          std::max(worst, std::abs(world.state(id).position.z() - bouncing(0.5, e, world.time())));
    }
    EXPECT_LT(worst, kPlaceAtTicks) << e;
    if (e < 1.0) {
      EXPECT_EQ(world.state(id).linear_velocity.z(), 0.0) << e;
    }
  }
}

// A rope on a brake slips with twice the weight: the load stops after falling as far again, and
// hangs.
TEST_P(AtTicks, ARopeOnABrakeSlipsUntilItHolds) {
  World world(by_events(GetParam()));
  const BodyId id = world.add_body(small_ball("ball", 2.0, {0.0, 0.0, -0.8}));
  Joint joint = hang("rope", id, rope(1.0));
  joint.motor.max_force = 2.0 * 2.0 * kGravity;
  const JointId rope_id = world.add_joint(joint);
  const double taut = std::sqrt(2.0 * 0.2 / kGravity), v = kGravity * taut;
  for (int i = 0; i * GetParam() < 0.8; ++i) {
    world.step();
    const double t = world.time(), since = std::clamp(t - taut, 0.0, taut);
    const double z = t < taut ? -0.8 - 0.5 * kGravity * t * t
                              : -1.0 - v * since + 0.5 * kGravity * since * since;
    ASSERT_NEAR(world.state(id).position.z(), z, kPlaceAtTicks) << t;
    ASSERT_LT(std::abs(world.joint_state(rope_id).error), 1e-9) << t;
    if (std::abs(t - taut) > kTimeAtTicks && std::abs(t - 2.0 * taut) > kTimeAtTicks) {
      ASSERT_EQ(world.joint_state(rope_id).saturated, t > taut && t < 2.0 * taut) << t;
    }
  }
}

// A motor needs time to reach its speed, with its largest force.
TEST_P(AtTicks, AMotorAtItsLimitAccelerates) {
  constexpr double kMass = 2.0, kForce = 5.0, kSpeed = 1.3;
  World world(by_events(GetParam(), 0.0));
  const BodyId id = world.add_body(small_ball("ball", kMass, Vector3d::Zero()));
  CoordinateLaw law;
  law.motor.emplace();
  law.motor->bias = kSpeed;
  law.motor->max_force = kForce;
  const JointId joint = world.add_joint(slider_along_z(id, law));
  const double there = kSpeed * kMass / kForce, a = kForce / kMass;
  for (int i = 0; i * GetParam() < 1.0; ++i) {
    world.step();
    const double t = world.time();
    const double z = t < there ? 0.5 * a * t * t : kSpeed * (t - 0.5 * there);
    ASSERT_NEAR(world.state(id).position.z(), z, kPlaceAtTicks) << t;
    if (std::abs(t - there) > kTimeAtTicks) {
      ASSERT_EQ(world.joint_state(joint).saturated, t < there) << t;
    }
  }
}

// A motor cannot follow the steepest part of a sinusoid, and catches up later.
TEST_P(AtTicks, AMotorAtItsLimitFollowsASinusoid) {
  constexpr double kForce = 1.0, kFrequency = 0.5, kAmplitude = 0.5;
  const double omega = 2.0 * kPi * kFrequency;
  World world(by_events(GetParam(), 0.0));
  const BodyId id = world.add_body(small_ball("ball", 1.0, Vector3d::Zero()));
  CoordinateLaw law;
  law.motor.emplace();
  law.motor->amplitude = kAmplitude;
  law.motor->frequency = kFrequency;
  law.motor->max_force = kForce;
  world.add_joint(slider_along_z(id, law));
  // starts at 0 with full force until the target speed is reached, along the target until it needs
  // more than −1 N, then with −1 N
  double low = 0.1, high = 0.9;
  for (int i = 0; i < 60; ++i) {
    const double t = 0.5 * (low + high);
    (kForce * t < kAmplitude * std::sin(omega * t) ? low : high) = t;
  }
  const double caught = low, lost = std::acos(-kForce / (kAmplitude * omega)) / omega;
  const auto place = [&](double t) {
    if (t < caught) return 0.5 * kForce * t * t;
    const auto driven = [&](double to) {
      return 0.5 * kForce * caught * caught +
             kAmplitude / omega * (std::cos(omega * caught) - std::cos(omega * to));
    };
    if (t < lost) return driven(t);
    return driven(lost) + kAmplitude * std::sin(omega * lost) * (t - lost) -
           0.5 * kForce * (t - lost) * (t - lost);
  };
  ASSERT_LT(caught, lost);
  for (int i = 0; (i + 1) * GetParam() < 1.2; ++i) {
    world.step();
    ASSERT_NEAR(world.state(id).position.z(), place(world.time()), kPlaceAtTicks) << world.time();
  }
}

TEST_P(AtTicks, FrictionStopsASlider) {
  constexpr double kMass = 2.0, kFriction = 3.0, kSpeed = 1.1;
  World world(by_events(GetParam(), 0.0));
  Body body = small_ball("ball", kMass, Vector3d::Zero());
  body.state.linear_velocity.z() = kSpeed;
  const BodyId id = world.add_body(body);
  CoordinateLaw law;
  law.friction = kFriction;
  world.add_joint(slider_along_z(id, law));
  EXPECT_EQ(only(world.islands()).why, MethodReason::kFriction);
  const double stop = kSpeed * kMass / kFriction, a = kFriction / kMass;
  for (int i = 0; i * GetParam() < 1.0; ++i) {
    world.step();
    const double t = std::min(world.time(), stop);
    ASSERT_NEAR(world.state(id).position.z(), kSpeed * t - 0.5 * a * t * t, kPlaceAtTicks) << t;
  }
  EXPECT_EQ(world.state(id).linear_velocity.z(), 0.0);
}

// Stick and slip: a spring k, whose other end moves at speed v, pulls a body with friction f. It
// sticks until k v t = f; then y = v τ − (v/ω) sin ωτ.
TEST_P(AtTicks, AnAnchorDraggedByASpringSticksAndSlips) {
  constexpr double kMass = 1.5, kFriction = 2.0, kStiffness = 30.0, kSpeed = 0.25;
  World world(by_events(GetParam(), 0.0));
  const BodyId id = world.add_body(small_ball("dragged", kMass, Vector3d::Zero()));
  Body puller = small_ball("puller", 1.0, {0.0, 0.0, 1.0});
  puller.state.linear_velocity.z() = kSpeed;
  puller.type = BodyType::kKinematic;
  const BodyId end = world.add_body(puller);
  CoordinateLaw law;
  law.friction = kFriction;
  world.add_joint(slider_along_z(id, law));
  world.add_joint(make_joint("spring", id, Vector3d::Zero(), end, Vector3d::Zero(),
                             spring(1.0, kStiffness, 0.0)));
  const double slips = kFriction / (kStiffness * kSpeed), omega = std::sqrt(kStiffness / kMass);
  for (int i = 0; (i + 1) * GetParam() < slips + 1.9 * kPi / omega; ++i) {
    world.step();
    const double tau = std::max(world.time() - slips, 0.0);
    const double y = kSpeed * tau - kSpeed / omega * std::sin(omega * tau);
    ASSERT_NEAR(world.state(id).position.z(), y, kPlaceAtTicks) << world.time();
  }
}

// A load of 1e4 kg on a rope, and a bob of 1 kg on a rod below it. The rope is slack at first: both
// fall, then the rope stops the load, and the bob continues straight down: two links from then on,
// by Lagrange's equations in long double.
TEST_P(AtTicks, AHeavyLoadOnARopeBesideALightBobOnARod) {
  World world(by_events(GetParam()));
  const BodyId load = world.add_body(small_ball("load", 1e4, {0.0, 0.0, -0.8}));
  const BodyId bob = world.add_body(small_ball("bob", 1.0, {1.0, 0.0, -0.8}));
  world.add_joint(hang("rope", load, rope(1.0)));
  const JointId rod_id =
      world.add_joint(make_joint("rod", load, Vector3d::Zero(), bob, Vector3d::Zero(), rod(1.0)));
  const double taut = std::sqrt(2.0 * 0.2 / kGravity);
  const problems::ChainInAngles links(2, 1.0L, 1e4L);
  problems::Reals y{-std::acos(-1.0L) / 2, 0, 0, -static_cast<long double>(kGravity * taut)};
  double least = world.energy(), at = taut, worst = 0.0;
  for (int i = 0; i * GetParam() < 2.0; ++i) {
    world.step();
    ASSERT_EQ(only(world.islands()).method, Method::kEventDriven);
    ASSERT_LT(world.report().joints.max_error, 1e-12);
    ASSERT_NEAR(distance(world, rod_id), 1.0, 1e-12);
    ASSERT_LT(world.energy(), least + 1e-4);  // 1e-9 of the energy
    least = std::min(least, world.energy());
    const double t = world.time(), fall = 0.8 + 0.5 * kGravity * t * t;
    std::vector<Vector3d> places{{0.0, 0.0, -fall}, {1.0, 0.0, -fall}};
    if (t > taut) {
      y = problems::integrate(links, y, static_cast<long double>(t) - at, 1, 12);
      at = t;
      places = problems::chain_positions(y);
    }
    worst = std::max({worst, (world.state(load).position - places[0]).norm(),
                      (world.state(bob).position - places[1]).norm()});
  }
  EXPECT_LT(worst, 5e-12);  // the tolerance with substeps of 1/30 s; rounding with shorter ones
}

// A bob released at the height of its pivot swings down; the rod's tension is 3 m g sin φ.
TEST_P(AtTicks, ARodBreaksWhereItsForceSays) {
  constexpr double kShare = 0.6;  // over 3 m g
  World world(by_events(GetParam()));
  const BodyId id = world.add_body(small_ball("bob", 1.0, {1.0, 0.0, 0.0}));
  Joint joint = hang("rod", id, rod(1.0));
  joint.break_force = 3.0 * kGravity * kShare;
  const JointId rod_id = world.add_joint(joint);
  EXPECT_EQ(only(world.islands()).why, MethodReason::kBreaks);
  const double phi = std::asin(kShare), breaks = time_of_fall(0.5 * kPi, 0.5 * kPi - phi, 1.0);
  const double speed = std::sqrt(2.0 * kGravity * kShare);
  const Vector3d x(std::cos(phi), 0.0, -std::sin(phi)),
      v = speed * Vector3d(-std::sin(phi), 0.0, -std::cos(phi));
  while (world.time() < breaks + 0.5) {
    world.step();
    const double since = world.time() - breaks;
    ASSERT_EQ(world.joint_state(rod_id).broken, since > 0.0) << world.time();
    if (since < 0.0) continue;
    const Vector3d place = x + since * v - Vector3d(0.0, 0.0, 0.5 * kGravity * since * since);
    ASSERT_LT((world.state(id).position - place).norm(), kPlaceAtTicks) << world.time();
  }
}

// Limits that are never reached change nothing, however many: 140 bars fall as without them, within
// the tolerance of both, 1e-10 m/s. Friction on as many hinges is left to impulses, with its
// reason.
TEST(ManyLaws, CountOnlyWhereTheyLast) {
  constexpr std::size_t kBars = 140;
  const std::vector<double> masses(kBars, 1.0);
  World limited = bars_on_hinges(by_events(0.01), masses, 0.1);
  World free = bars_on_hinges(by_events(Carried{0.01, Method::kAuto}), masses, 0.1);
  World rough = bars_on_hinges(by_events(Carried{0.01, Method::kAuto}), masses, 0.1);
  for (const JointId id : limited.joint_ids()) {
    CoordinateLaw law;
    law.lower = -3.0;
    law.upper = 3.0;
    limited.set_law(id, 0, law);
    law = {};
    law.friction = 0.1;
    rough.set_law(id, 0, law);
  }
  run(limited, 20);
  run(free, 20);
  EXPECT_EQ(limited.islands().front().method, Method::kEventDriven);
  for (const BodyId id : free.body_ids())
    EXPECT_LT((limited.state(id).position - free.state(id).position).norm(), 1e-9);
  EXPECT_EQ(rough.islands().front().why, MethodReason::kManyRows);
}

/// Returns balls on a square grid. Ropes join neighbours in each row and, in a net, in each column.
/// Both corners of the first row are held.
World balls_on_ropes(int rows, int columns, bool is_net) {
  World world(by_events(Carried{0.01, Method::kAuto}));
  std::vector<BodyId> balls;
  const auto at = [&](int row, int column) { return Vector3d(0.1 * column, 0.1 * row, 0.0); };
  const auto join = [&](BodyId a, BodyId b) {
    DistanceJoint rope;
    rope.max_length = 0.102;
    const std::string name = "rope_" + std::to_string(world.joint_ids().size());
    world.add_joint(make_joint(name, a, Vector3d::Zero(), b, Vector3d::Zero(), rope));
  };
  for (int row = 0; row < rows; ++row)
    for (int column = 0; column < columns; ++column) {
      const std::string name = "ball_" + std::to_string(balls.size());
      Body ball = small_ball(name, 0.01, at(row, column));
      ball.no_collision = true;
      balls.push_back(world.add_body(ball));
      if (column > 0) join(balls[balls.size() - 2], balls.back());
      if (is_net && row > 0) join(balls[balls.size() - 1 - to_index(columns)], balls.back());
    }
  for (const int column : {0, columns - 1})
    world.add_joint(make_joint("pin_" + std::to_string(column), kWorldBody, at(0, column),
                               balls[to_index(column)], Vector3d::Zero(), JointKind::kBall));
  return world;
}

// The ropes of a chain stay taut, so that events follow any number of them, within rounding. In a
// net ropes become taut and slack by turns: too many are left to impulses, with the reason.
TEST(ManyLaws, OfRopesAreFollowedInAChainAndLeftInANet) {
  World chain = balls_on_ropes(1, 60, false);
  for (int i = 0; i < 30; ++i) {
    const StepReport& report = chain.step();
    ASSERT_EQ(chain.islands().front().method, Method::kEventDriven);
    ASSERT_LT(report.joints.max_error, 1e-13);
  }
  World net = balls_on_ropes(6, 6, true);
  net.step();
  EXPECT_EQ(net.islands().front().why, MethodReason::kManyRows);
  World small = balls_on_ropes(4, 4, true);
  small.step();
  EXPECT_EQ(small.islands().front().method, Method::kEventDriven);
}

// Friction on 60 hinges is followed by events: time steps of 1/50 and 1/200 s give the same motion
// within the tolerance of both, 1e-10 m/s.
TEST(ManyLaws, WithFrictionAreFollowedByEvents) {
  const std::vector<double> masses(60, 1.0);
  std::vector<World> worlds;
  for (const double tick : {0.02, 0.005}) {
    World& world =
        worlds.emplace_back(bars_on_hinges(by_events(Carried{tick, Method::kAuto}), masses, 0.1));
    for (const JointId id : world.joint_ids()) {
      CoordinateLaw law;
      law.friction = 0.1;
      world.set_law(id, 0, law);
    }
    run(world, static_cast<int>(std::lround(0.2 / tick)));
    EXPECT_EQ(world.islands().front().method, Method::kEventDriven);
  }
  for (const BodyId id : worlds[0].body_ids())
    EXPECT_LT((worlds[0].state(id).position - worlds[1].state(id).position).norm(), 1e-9);
}

}  // namespace
}  // namespace constraint_sim::engine
