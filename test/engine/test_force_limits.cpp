// Force-limited springs, servos and position-controlled motors, event-driven. Oracles: closed forms
// of the motion between the times at which the limit is reached and left, which bisection finds.
// Times are correct to 1e-9 s and positions to 1e-8 m at any tick; errors are rounding and the
// tolerance.

#include <tuple>
#include <utility>

#include "by_events.h"
#include "constraint_sim/engine/scene.h"
#include "engine/constraints/prescribed.h"
#include "support.h"

namespace constraint_sim::engine {
namespace {

using Eigen::Vector3d;

constexpr double kSlidingMass = 2.0;

WorldOptions automatic(const Carried& by, double gravity = 0.0) { return by_events(by, gravity); }

WorldOptions automatic(double time_step) { return automatic(Carried{time_step, Method::kAuto}); }

/// A body on a slider of the world along z, with a law.
struct Slider {
  World world;
  BodyId id;
  JointId joint;

  Slider(const WorldOptions& options, const CoordinateLaw& law, double speed = 0.0)
      : world(options) {
    Body body = make_body("body", Sphere{0.1}, kSlidingMass, Vector3d::Zero());
    body.state.linear_velocity.z() = speed;
    id = world.add_body(body);
    Joint slider = make_joint("slider", kWorldBody, Vector3d::Zero(), id, Vector3d::Zero(),
                              JointKind::kSlider);
    slider.coordinates[0] = law;
    joint = world.add_joint(slider);
  }
  double q() const { return world.state(id).position.z(); }
  double rate() const { return world.state(id).linear_velocity.z(); }
  const JointState& state() const { return world.joint_state(joint); }
  void push(double force, double start, double duration) {
    Wrench wrench;
    wrench.body = id;
    wrench.force = {0.0, 0.0, force};
    wrench.start = start;
    wrench.end = start + duration;
    world.add_wrench(wrench);
  }
};

CoordinateLaw servo(double position, double stiffness, double damping, double most) {
  CoordinateLaw law;
  law.motor.emplace();
  law.motor->position = position;
  law.motor->servo_stiffness = stiffness;
  law.motor->servo_damping = damping;
  law.motor->max_force = most;
  return law;
}

CoordinateLaw to_position(double position, double most) {
  CoordinateLaw law;
  law.motor.emplace();
  law.motor->position = position;
  law.motor->max_force = most;
  return law;
}

double bisect(double low, double high, const std::function<bool(double)>& is_before) {
  for (int i = 0; i < 200; ++i) {
    const double middle = 0.5 * (low + high);
    (is_before(middle) ? low : high) = middle;
  }
  return low;
}

/// Solution of m q̈ = load + clamp(K (R − q) − C q̇): pieces of the underdamped oscillator and of
/// parabolas.
struct LimitedOscillator {
  double K, R, C, most, load;
  double t = 0.0, q = 0.0, v = 0.0;  // start of the piece
  int side = 0;                      // 0: not at the limit
  std::vector<double> changes{};     // times of changes of the side

  std::pair<double, double> after(double h) const {
    if (side != 0) {
      const double a = (load + side * most) / kSlidingMass;
      return {q + v * h + 0.5 * a * h * h, v + a * h};
    }
    const double delta = 0.5 * C / kSlidingMass,
                 omega = std::sqrt(K / kSlidingMass - delta * delta);
    const double center = R + load / K, y = q - center, b = (v + delta * y) / omega;
    const double decay = std::exp(-delta * h), c = std::cos(omega * h), s = std::sin(omega * h);
    const double now = decay * (y * c + b * s);
    return {center + now, decay * omega * (b * c - y * s) - delta * now};
  }
  double force(double h) const {
    const auto [x, u] = after(h);
    return K * (R - x) - C * u;
  }
  int side_at(double h) const {
    const double f = force(h);
    return f > most ? 1 : (f < -most ? -1 : 0);
  }
  /// Advances to a time.
  double at(double time) {
    constexpr double kScan = 1e-3;
    if (changes.empty()) {
      side = side_at(0.0);
      changes.push_back(0.0);
    }
    for (;;) {
      double h = kScan;
      while (t + h < time && side_at(h) == side) h += kScan;
      h = std::min(h, time - t);
      if (side_at(h) == side) return after(h).first;
      const double change = bisect(std::max(h - kScan, 0.0), h,
                                   [&](double x) { return x == 0.0 || side_at(x) == side; });
      const int next = side_at(h);
      std::tie(q, v) = after(change);
      t += change;
      side = next;
      changes.push_back(t);
    }
  }
};

class ForceLimitsAt : public testing::TestWithParam<Carried> {
 protected:
  int steps(double seconds) const { return static_cast<int>(std::lround(seconds / GetParam())); }
};

INSTANTIATE_TEST_SUITE_P(Ticks, ForceLimitsAt, testing::ValuesIn(each_setting(Method::kAuto)));

// ---- servos and springs

TEST_P(ForceLimitsAt, AServoIsAtItsLimitUntilItIsNear) {
  for (const double damping : {12.0, 1.0}) {  // the second one reaches its limit repeatedly
    for (const double gravity : {0.0, kGravity}) {
      Slider slider(automatic(GetParam(), gravity), servo(1.0, 60.0, damping, 30.0));
      EXPECT_EQ(slider.world.islands().front().why, MethodReason::kForceLimit);
      LimitedOscillator exact{60.0, 1.0, damping, 30.0, -kSlidingMass * gravity};
      std::vector<double> told;
      for (int i = 0; i < steps(3.0); ++i) {
        slider.world.step();
        for (const Event& event : slider.world.events()) told.push_back(event.time);
        ASSERT_EQ(slider.world.islands().front().method, Method::kEventDriven);
        ASSERT_NEAR(slider.q(), exact.at(slider.world.time()), kPlaceAtTicks)
            << slider.world.time();
        if (std::abs(slider.world.time() - exact.changes.back()) > kTimeAtTicks) {
          ASSERT_EQ(slider.state().saturated, exact.side != 0) << slider.world.time();
        }
      }
      ASSERT_EQ(told.size() + 1, exact.changes.size()) << damping;
      for (std::size_t k = 0; k < told.size(); ++k)
        EXPECT_NEAR(told[k], exact.changes[k + 1], kTimeAtTicks);
      EXPECT_GE(told.size(), damping < 2.0 ? 4u : 1u);
    }
  }
}

TEST_P(ForceLimitsAt, ASpringOfALengthIsAtItsLimitUntilItIsNear) {
  World world(automatic(GetParam(), kGravity));
  const BodyId id = world.add_body(make_body("ball", Sphere{0.1}, kSlidingMass, {0.0, 0.0, -1.5}));
  Joint joint = hang("spring", id, spring(1.0, 200.0, 4.0));
  joint.motor.max_force = 50.0;
  const JointId of = world.add_joint(joint);
  EXPECT_EQ(world.islands().front().why, MethodReason::kForceLimit);
  LimitedOscillator exact{200.0, 1.0, 4.0, 50.0, kSlidingMass * kGravity};  // along −z
  exact.q = 1.5;
  double energy = world.energy();
  for (int i = 0; i < steps(2.0); ++i) {
    world.step();
    ASSERT_EQ(world.islands().front().method, Method::kEventDriven);
    ASSERT_NEAR(-world.state(id).position.z(), exact.at(world.time()), kPlaceAtTicks)
        << world.time();
    if (std::abs(world.time() - exact.changes.back()) > kTimeAtTicks) {
      ASSERT_EQ(world.joint_state(of).saturated, exact.side != 0);
    }
    ASSERT_LT(world.energy(),
              energy + 1e-8);  // energy of the force-limited spring; dampers lower it
    energy = world.energy();
  }
  EXPECT_GT(exact.changes.size(), 2u);
}

// A spring whose other end is moved by a motor.
TEST_P(ForceLimitsAt, ASpringThatAMotorWindsSlipsNoFurtherThanItsLimit) {
  World world(automatic(GetParam()));
  const BodyId id = world.add_body(make_body("ball", Sphere{0.1}, kSlidingMass, {0.0, 0.0, -1.0}));
  Joint joint = hang("spring", id, spring(1.0, 30.0, 0.0));
  joint.motor.max_force = 2.0;
  joint.motor.bias = 0.5;
  world.add_joint(joint);
  // seen from the other end the mass starts with −0.5 m/s
  LimitedOscillator exact{30.0, 0.0, 0.0, 2.0, 0.0};
  exact.v = -0.5;
  for (int i = 0; i < steps(2.0); ++i) {
    world.step();
    const double expected = 1.0 + 0.5 * world.time() + exact.at(world.time());
    ASSERT_NEAR(-world.state(id).position.z(), expected, kPlaceAtTicks) << world.time();
  }
  EXPECT_GT(exact.changes.size(), 3u);
}

TEST_P(ForceLimitsAt, AServoBelowItsLimitIsTheOneWithout) {
  Slider with(automatic(GetParam(), kGravity), servo(0.3, 60.0, 3.0, 1000.0)),
      without(automatic(GetParam(), kGravity), servo(0.3, 60.0, 3.0, 0.0));
  EXPECT_EQ(without.world.islands().front().method, Method::kRungeKutta);
  for (int i = 0; i < steps(2.0); ++i) {
    with.world.step();
    without.world.step();
    ASSERT_EQ(with.q(), without.q());
    ASSERT_EQ(with.rate(), without.rate());
    ASSERT_EQ(with.world.report().costs.events, 0u);
  }
}

// The number of substeps grows with the frequency; an extremely stiff servo is left to impulses,
// which is reported.
TEST(ForceLimits, AStiffServoIsFollowedBySubsteps) {
  for (const double omega : {1e2, 1e4, 2e5}) {
    const double K = kSlidingMass * omega * omega;
    for (const Method method : {Method::kAuto, Method::kEventDriven}) {
      WorldOptions options = automatic(1.0 / 60);
      options.tolerance = 1e-8;
      options.method = method;
      if (omega > 1e5 && method == Method::kEventDriven) continue;  // some 1e4 substeps a tick
      Slider slider(options, servo(0.01, K, 2.0 * kSlidingMass * omega, 0.005 * K));
      const bool is_left = omega > 1e5;
      EXPECT_EQ(slider.world.islands().front().why,
                is_left ? MethodReason::kLimitedSpring : MethodReason::kForceLimit);
      std::uint32_t most = 0;
      for (int i = 0; i < 30; ++i) {
        slider.world.step();
        most = std::max(most, slider.world.islands().front().substeps);
      }
      EXPECT_LT(most, 500u) << omega;
      EXPECT_NEAR(slider.q(), 0.01, is_left ? 1e-3 : 1e-8) << omega;
    }
  }
}

// ---- position-controlled motors

TEST_P(ForceLimitsAt, AMotorBelowItsLimitIsTheOneWithout) {
  Slider with(automatic(GetParam(), kGravity), to_position(0.4, 1000.0)),
      without(automatic(GetParam(), kGravity), to_position(0.4, 0.0));
  EXPECT_EQ(with.world.islands().front().why, MethodReason::kForceLimit);
  for (int i = 0; i < steps(1.5); ++i) {
    with.world.step();
    without.world.step();
    ASSERT_NEAR(with.q(), without.q(), 1e-14);
    ASSERT_NEAR(with.rate(), without.rate(), 1e-13);
    ASSERT_NEAR(with.state().force, without.state().force, 1e-9);
    ASSERT_EQ(with.state().error, without.state().error);
    ASSERT_EQ(with.world.report().costs.events, 0u);
  }
  EXPECT_EQ(with.q(), 0.4);
}

// The motor follows its path until that needs more than its force, then uses its full force, then
// half of it to stop.
TEST_P(ForceLimitsAt, AMotorTooWeakForItsMotionStopsInItsPositionAllTheSame) {
  constexpr double kForce = 6.0, kGoal = 0.8;
  Slider slider(automatic(GetParam()), to_position(kGoal, kForce));
  const double T = slider.world.options().closing_time;
  const auto motion = [&](double t) { return closing_motion(t, T); };
  const double lost = bisect(0.0, 0.2 * T, [&](double t) {
    return -kGoal * motion(t).acceleration * kSlidingMass < kForce;
  });
  ASSERT_LT(lost, 0.19 * T);
  const double q1 = kGoal * (1.0 - motion(lost).value), v1 = -kGoal * motion(lost).rate;
  const double a = kForce / kSlidingMass, b = 0.5 * a;
  const double q2 = (2.0 * b * kGoal + 2.0 * a * q1 - v1 * v1) / (2.0 * (a + b));
  const double v2 = std::sqrt(2.0 * b * (kGoal - q2)), brakes = lost + (v2 - v1) / a,
               rests = brakes + v2 / b;
  std::vector<Event> told;
  for (int i = 0; i < steps(3.0); ++i) {
    slider.world.step();
    for (const Event& event : slider.world.events()) told.push_back(event);
    const double t = slider.world.time(), since = t - lost, left = rests - t;
    const double q = t < lost     ? kGoal * (1.0 - motion(t).value)
                     : t < brakes ? q1 + v1 * since + 0.5 * a * since * since
                     : t < rests  ? kGoal - 0.5 * b * left * left
                                  : kGoal;
    ASSERT_NEAR(slider.q(), q, kPlaceAtTicks) << t;
    if (std::abs(t - lost) > kTimeAtTicks && std::abs(t - brakes) > kTimeAtTicks) {
      ASSERT_EQ(slider.state().saturated, t > lost && t < brakes) << t;
    }
    if (t - GetParam() > brakes && t < rests) {
      ASSERT_NEAR(slider.state().force, -0.5 * kForce, 1e-8);
    }
  }
  ASSERT_EQ(told.size(), 2u);
  EXPECT_EQ(told[0].kind, EventKind::kSaturated);
  EXPECT_NEAR(told[0].time, lost, kTimeAtTicks);
  EXPECT_EQ(told[1].kind, EventKind::kReleased);
  EXPECT_NEAR(told[1].time, brakes, kTimeAtTicks);
  EXPECT_NEAR(slider.q(), kGoal, 1e-15);
  EXPECT_EQ(slider.rate(), 0.0);
}

// A load pushes the motor away for a while; then the motor returns.
TEST_P(ForceLimitsAt, AMotorThatALoadPushesAwayComesBack) {
  constexpr double kForce = 15.0, kLoad = -20.0, kFor = 0.5;
  Slider slider(automatic(GetParam()), to_position(0.0, kForce));
  slider.push(kLoad, 0.1, kFor);
  const double away = (kForce + kLoad) / kSlidingMass, end = 0.1 + kFor;
  const double q1 = 0.5 * away * kFor * kFor, v1 = away * kFor, a = kForce / kSlidingMass,
               b = 0.5 * a;
  const double q2 = (2.0 * a * q1 - v1 * v1) / (2.0 * (a + b)), v2 = std::sqrt(-2.0 * b * q2);
  const double brakes = end + (v2 - v1) / a, rests = brakes + v2 / b;
  for (int i = 0; i < steps(3.0); ++i) {
    slider.world.step();
    const double t = slider.world.time(), since = t - end, left = rests - t, gone = t - 0.1;
    const double q = t < 0.1      ? 0.0
                     : t < end    ? 0.5 * away * gone * gone
                     : t < brakes ? q1 + v1 * since + 0.5 * a * since * since
                     : t < rests  ? -0.5 * b * left * left
                                  : 0.0;
    ASSERT_NEAR(slider.q(), q, kPlaceAtTicks) << t;
    if (std::abs(t - 0.1) > kTimeAtTicks && std::abs(t - brakes) > kTimeAtTicks) {
      ASSERT_EQ(slider.state().saturated, t > 0.1 && t < brakes) << t;
    }
  }
}

// A motor that a short load throws off its prescribed motion comes back with all its force, and
// arrives before that motion ends. It rests at its position, and the motion is over.
TEST_P(ForceLimitsAt, AMotorThatArrivesBeforeItsMotionRestsThere) {
  constexpr double kGoal = 0.4;
  Slider slider(automatic(GetParam()), to_position(kGoal, 200.0));
  slider.push(-400.0, 0.1, 0.01);
  for (int i = 0; i < steps(1.0); ++i) {
    ASSERT_FALSE(slider.world.step().outcome.failed);
    ASSERT_NE(slider.world.islands().front().why, MethodReason::kRefused) << i;
    // 0.15 s with accelerations of 100 and 50 m/s² from rest over the whole way
    if (slider.world.time() < 0.1 + 0.01 + 0.02 + 0.15) continue;
    ASSERT_NEAR(slider.q(), kGoal, kPlaceAtTicks) << i;
    ASSERT_NEAR(slider.rate(), 0.0, 1e-8) << i;
    ASSERT_FALSE(slider.state().saturated) << i;
  }
}

// Friction adds to the force of a motor that holds, and acts with or against a motor that slips.
TEST_P(ForceLimitsAt, AMotorHoldsWithItsForceAndFriction) {
  CoordinateLaw law = to_position(0.0, 5.0);
  law.friction = 1.0;
  Slider holds(automatic(GetParam()), law), gives_way(automatic(GetParam()), law);
  holds.push(5.9, 0.0, 0.4);
  gives_way.push(8.0, 0.0, 0.4);
  for (int i = 0; i < steps(0.4); ++i) {
    holds.world.step();
    gives_way.world.step();
    const double t = gives_way.world.time();
    ASSERT_EQ(holds.q(), 0.0);
    ASSERT_FALSE(holds.state().saturated);
    if (t > 0.4) break;
    ASSERT_NEAR(gives_way.q(), 0.5 * (8.0 - 6.0) / kSlidingMass * t * t, kPlaceAtTicks);
  }
  // The motor brakes without counting on friction: b is its own force.
  run(gives_way.world, steps(2.0));
  EXPECT_NEAR(gives_way.q(), 0.0, 1e-10);
  EXPECT_EQ(gives_way.rate(), 0.0);
  EXPECT_FALSE(gives_way.state().saturated);
}

// A stop before the target position: the motor presses on the stop, and reports only that.
TEST_P(ForceLimitsAt, AMotorPressesAgainstAStop) {
  CoordinateLaw law = to_position(0.5, 4.0);
  law.upper = 0.2;
  Slider slider(automatic(GetParam()), law);
  run(slider.world, steps(2.0));
  EXPECT_NEAR(slider.q(), 0.2, 1e-12);
  EXPECT_EQ(slider.rate(), 0.0);
  slider.push(-3.0, slider.world.time(), 0.5);  // less than the motor's force
  run(slider.world, steps(0.4));
  EXPECT_NEAR(slider.q(), 0.2, 1e-12);
}

// Two links under gravity, lifted by motors too weak for their paths: neither overshoots by more
// than the other link's motion causes, and both arrive.
TEST_P(ForceLimitsAt, AnArmWithWeakMotorsComesToItsPosition) {
  World world(automatic(GetParam(), kGravity));
  const auto link = [&](const char* name, double x) {
    return world.add_body(make_body(name, Box{{1.0, 0.1, 0.1}}, 1.0, {x, 0.0, 0.0}));
  };
  const BodyId upper = link("upper", 0.5), lower = link("lower", 1.5);
  const auto hinge = [&](const char* name, BodyId a, double x, BodyId b, double goal, double most) {
    Joint joint = make_joint(name, a, {x, 0.0, 0.0}, b, {-0.5, 0.0, 0.0}, JointKind::kHinge);
    joint.frame_a = frame_along({0.0, -1.0, 0.0});
    joint.coordinates[0] = to_position(goal, most);
    return world.add_joint(joint);
  };
  const JointId shoulder = hinge("shoulder", kWorldBody, 0.0, upper, 1.2, 40.0);
  const JointId elbow = hinge("elbow", upper, 0.5, lower, -0.9, 12.0);
  double most[2] = {0.0, 0.0};
  bool was_saturated = false;
  std::uint32_t events = 0;
  for (int i = 0; i < steps(4.0); ++i) {
    world.step();
    ASSERT_EQ(world.islands().front().method, Method::kEventDriven);
    most[0] = std::max(most[0], world.joint_state(shoulder).coordinates[0].position - 1.2);
    most[1] = std::max(most[1], -0.9 - world.joint_state(elbow).coordinates[0].position);
    was_saturated = was_saturated || world.joint_state(shoulder).saturated;
    events += world.report().costs.events;
  }
  EXPECT_TRUE(was_saturated);
  EXPECT_LT(most[0], 0.1);
  EXPECT_LT(most[1], 0.1);
  EXPECT_LT(events, 30u);
  EXPECT_NEAR(world.joint_state(shoulder).coordinates[0].position, 1.2, 1e-9);
  EXPECT_NEAR(world.joint_state(elbow).coordinates[0].position, -0.9, 1e-9);
  EXPECT_LT(world.report().joints.max_error, 1e-9);
}

// Between two steps only, the demand of a motor turns away from a stop, and a spring needs more
// than the motor has. Oracle: steps a hundredth as long, which show both at their ends.
TEST(ForceLimits, AreSeenBetweenSteps) {
  CoordinateLaw pressed;  // by half more than its weight
  pressed.lower = 0.0;
  pressed.motor = Motor{0.0, 1.0, 14.0, kPi, 1.5 * kSlidingMass * kGravity, 0.0};
  CoordinateLaw wound;  // the spring's force is 2 k A / ω at the middle of a period
  wound.stiffness = 300.0;
  wound.motor = Motor{0.0, 1.0, 10.0, 0.0, 8.0, 0.0};
  for (const int order : {5, 8})
    for (const auto& [law, gravity] : {std::pair(pressed, kGravity), std::pair(wound, 0.0)}) {
      WorldOptions options = by_events(0.1, gravity);
      options.order = order;
      Slider coarse(options, law);
      options.time_step = 0.001;
      Slider fine(options, law);
      for (int i = 0; i < 5; ++i) {
        coarse.world.step();
        run(fine.world, 100);
        EXPECT_NEAR(coarse.q(), fine.q(), 1e-8) << order << " " << i;
      }
      EXPECT_GT(std::abs(fine.q()), 1e-4);
    }
}

// A world saved while the motor is saturated, or brakes, continues unchanged.
TEST(ForceLimits, GoOnWhenSavedAndLoaded) {
  Slider slider(automatic(1.0 / 60), to_position(0.8, 6.0));
  for (int k = 0; k < 4; ++k) {
    run(slider.world, 10);
    const std::string text = save_scene(slider.world);
    World again = load_scene(text), same = slider.world;
    EXPECT_EQ(save_scene(again), text);
    run(again, 60);
    run(same, 60);
    EXPECT_NEAR(again.state(again.find_body("body")).position.z(),
                same.state(slider.id).position.z(), 1e-9);
  }
}

// A new target while saturated starts a new path.
TEST(ForceLimits, ANewPositionIsANewMotion) {
  Slider slider(automatic(1.0 / 240), to_position(0.8, 6.0));
  run(slider.world, 60);
  EXPECT_TRUE(slider.state().saturated);
  Motor motor = *slider.world.joint(slider.joint).coordinates[0].motor;
  motor.position = -0.1;
  slider.world.set_motor(slider.joint, 0, motor);
  run(slider.world, 3 * 240);
  EXPECT_EQ(slider.q(), -0.1);
  EXPECT_EQ(slider.rate(), 0.0);
  EXPECT_FALSE(slider.state().saturated);
}

}  // namespace
}  // namespace constraint_sim::engine
