// Motors, springs, ropes, struts, breaking, and joints of zero length.

#include "engine/constraints/joint.h"
#include "support.h"

namespace constraint_sim::engine {
namespace {

using Eigen::Vector3d;

constexpr double kRoundOff = 1e-12;  // rounding of lengths and speeds around 1 in hundreds of steps

/// A point mass that hangs straight below the world's origin on one joint. Motion stays on that
/// line, where velocity steps have no error of their own.
struct Hanging {
  World world;
  BodyId load;
  JointId joint;

  Hanging(const WorldOptions& options, double mass, double depth, const JointType& type,
          const Motor& motor = {}, double break_force = 0.0)
      : world(options) {
    load = world.add_body(make_body("load", Point{}, mass, {0.0, 0.0, -depth}));
    Joint hung = hang("line", load, type);
    hung.motor = motor;
    hung.break_force = break_force;
    joint = world.add_joint(hung);
  }

  double length() const { return distance(world, joint); }
  const JointState& state() const { return world.joint_state(joint); }
};

// ---- motors

TEST(Motor, ConstantBiasIsReachedInTheFirstStepAndTravels) {
  for (const double bias : {-0.2, 0.3}) {
    Hanging hanging(options(0.01), 5.0, 1.0, rod(1.0), rate_motor(bias));
    for (int step = 1; step <= 200; ++step) {
      hanging.world.step();
      EXPECT_NEAR(hanging.state().reached_rate, bias, kRoundOff);
      EXPECT_NEAR(hanging.state().bias, bias, kRoundOff);
      EXPECT_NEAR(hanging.state().error, 0.0, kRoundOff);
      EXPECT_NEAR(hanging.state().error_rate, 0.0, kRoundOff);
      EXPECT_NEAR(hanging.length(), 1.0 + bias * 0.01 * step, kRoundOff);
    }
    EXPECT_NEAR(hanging.state().travel, bias * 2.0, kRoundOff);
    EXPECT_NEAR(hanging.state().force, -5.0 * kGravity, 1e-9);  // tension: h·force to rounding
    EXPECT_FALSE(hanging.state().saturated);
  }
}

// The length is L + ∫ζ dt in closed form. 1e5 steps round a length of 1 m twice each, 2e-11 m in
// total; a phase wrong by one step would cause 1e-3 m.
TEST(Motor, SinusoidFollowsItsIntegralAndStaysInPhase) {
  Motor sinusoid;
  sinusoid.bias = 1e-4;
  sinusoid.amplitude = 0.5;
  sinusoid.frequency = 0.77;
  sinusoid.phase = 0.6;
  Hanging hanging(options(0.01), 2.0, 1.0, rod(1.0), sinusoid);
  const double omega = 2.0 * kPi * sinusoid.frequency;
  double worst = 0.0;
  for (int step = 0; step < 100000; ++step) {
    const double t = hanging.world.step().time;
    const double swing = 0.5 / omega * (std::cos(0.6) - std::cos(omega * t + 0.6));
    worst = std::max(worst, std::abs(hanging.length() - (1.0 + 1e-4 * t + swing)));
  }
  EXPECT_LT(worst, 2e-11);
}

// In a tick of several periods of the sinusoid, the motor drives its mean over the tick.
TEST(Motor, SinusoidFasterThanTheTickKeepsItsMean) {
  Motor sinusoid;
  sinusoid.amplitude = 0.5;
  sinusoid.frequency = 33.0;
  Hanging hanging(weightless(0.1), 2.0, 1.0, rod(1.0), sinusoid);
  const double omega = 2.0 * kPi * 33.0;
  for (int step = 0; step < 50; ++step) {
    const double t = hanging.world.step().time;
    EXPECT_NEAR(hanging.length(), 1.0 + 0.5 / omega * (1.0 - std::cos(omega * t)), kRoundOff);
  }
}

TEST(Motor, WithoutBiasItHoldsWhatItHasReached) {
  Hanging hanging(options(0.01), 5.0, 1.0, rod(1.0), rate_motor(-0.2));
  run(hanging.world, 150);
  hanging.world.set_motor(hanging.joint, rate_motor(0.0));
  run(hanging.world, 300);
  EXPECT_NEAR(hanging.length(), 0.7, kRoundOff);
  EXPECT_NEAR(hanging.state().reached_rate, 0.0, kRoundOff);
  EXPECT_EQ(hanging.state().bias, 0.0);
}

TEST(Motor, CanBeSetWhileRunning) {
  Hanging hanging(options(0.01), 5.0, 1.0, rod(1.0), rate_motor(-0.2));
  run(hanging.world, 100);
  hanging.world.set_motor(hanging.joint, rate_motor(0.5));
  run(hanging.world, 100);
  EXPECT_NEAR(hanging.length(), 1.0 - 0.2 + 0.5, kRoundOff);
  EXPECT_EQ(hanging.world.joint(hanging.joint).motor.bias, 0.5);
}

// The travel is bias times timeout, wherever in a tick the timeout is and however it is rounded.
TEST(Motor, TimeoutEndsTheBiasOnTime) {
  for (int start = 0; start < 60; ++start) {
    for (const double timeout : {0.1, 0.3, 0.305}) {
      Hanging hanging(weightless(0.01), 5.0, 1.0, rod(1.0));
      run(hanging.world, start);
      hanging.world.set_motor(hanging.joint, rate_motor(-0.2, 0.0, timeout));
      run(hanging.world, 60);
      EXPECT_NEAR(hanging.length(), 1.0 - 0.2 * timeout, kRoundOff) << start << ", " << timeout;
    }
  }
}

TEST(Motor, TimeoutLeavesTheSinusoidRunning) {
  Motor both = rate_motor(-0.2, 0.0, 0.5);
  both.amplitude = 0.3;
  both.frequency = 1.0;
  Hanging hanging(weightless(0.01), 5.0, 1.0, rod(1.0), both);
  run(hanging.world, 125);
  EXPECT_NEAR(hanging.length(), 1.0 - 0.1 + 0.3 / (2.0 * kPi), kRoundOff);
}

TEST(Motor, NewTimeoutReplacesTheOld) {
  Hanging hanging(weightless(0.01), 5.0, 1.0, rod(1.0), rate_motor(-0.2, 0.0, 0.5));
  run(hanging.world, 40);
  hanging.world.set_motor(hanging.joint, rate_motor(-0.2, 0.0, 0.5));
  run(hanging.world, 100);
  EXPECT_NEAR(hanging.length(), 1.0 - 0.2 * 0.9, kRoundOff);
}

TEST(Motor, TimeoutSurvivesAJumpOfTheClock) {
  Hanging hanging(weightless(0.01), 5.0, 1.0, rod(1.0), rate_motor(-0.2, 0.0, 0.5));
  hanging.world.set_time(1000.0, 7);
  run(hanging.world, 100);
  EXPECT_NEAR(hanging.length(), 0.9, 1e-10);  // times of 1000 s are rounded to 1e-13 s a step
}

// 60 N lift 49.05 N: with (60 − 49.05)/5 m/s² to 0.2 m/s, then evenly.
TEST(Motor, ForceLimitAboveTheLoadLifts) {
  Hanging hanging(options(0.01), 5.0, 1.0, rod(1.0), rate_motor(-0.2, 60.0));
  hanging.world.step();
  EXPECT_TRUE(hanging.state().saturated);
  EXPECT_NEAR(hanging.state().force, -60.0, 1e-9);
  EXPECT_NEAR(hanging.state().reached_rate, -(60.0 / 5.0 - kGravity) * 0.01, kRoundOff);
  run(hanging.world, 99);
  EXPECT_FALSE(hanging.state().saturated);
  EXPECT_NEAR(hanging.state().force, -5.0 * kGravity, 1e-9);
  EXPECT_NEAR(hanging.state().reached_rate, -0.2, kRoundOff);
  EXPECT_NEAR(hanging.state().error, 0.0, kRoundOff);
}

// 40 N do not hold 49.05 N: the load falls with g − 40/5.
TEST(Motor, ForceLimitBelowTheLoadYields) {
  Hanging hanging(options(0.01), 5.0, 1.0, rod(1.0), rate_motor(-0.2, 40.0));
  for (int step = 1; step <= 100; ++step) {
    hanging.world.step();
    EXPECT_TRUE(hanging.state().saturated);
    EXPECT_NEAR(hanging.state().force, -40.0, 1e-9);
    EXPECT_NEAR(hanging.state().reached_rate, (kGravity - 8.0) * 0.01 * step, kRoundOff);
    EXPECT_NEAR(hanging.state().error, 0.0, kRoundOff);  // slips without building up an error
  }
}

TEST(Motor, ForceLimitHoldsWhatIsReachedOnceItCan) {
  Hanging hanging(options(0.01), 5.0, 1.0, rod(1.0), rate_motor(-0.2, 40.0));
  run(hanging.world, 100);
  hanging.world.set_motor(hanging.joint, rate_motor(0.0, 200.0));
  run(hanging.world, 100);
  const double reached = hanging.length();
  EXPECT_GT(reached, 1.0);
  EXPECT_FALSE(hanging.state().saturated);
  run(hanging.world, 200);
  EXPECT_NEAR(hanging.length(), reached, kRoundOff);
  EXPECT_NEAR(hanging.state().error, 0.0, kRoundOff);
}

// Saturation is reported for a limit with any digits.
TEST(Motor, SaturationIsSeenForEveryLimit) {
  for (double limit = 0.1; limit < 40.0; limit += 0.37) {
    for (const double time_step : {0.01, 1.0 / 30.0, 0.003}) {
      Hanging hanging(options(time_step), 5.0, 1.0, rod(1.0), rate_motor(0.0, limit));
      run(hanging.world, 3);
      EXPECT_TRUE(hanging.state().saturated) << limit << " N, " << time_step << " s";
      EXPECT_NEAR(hanging.state().error, 0.0, kRoundOff) << limit << " N, " << time_step << " s";
    }
  }
}

TEST(Motor, WindingInStopsAtOneHundredthOfTheLength) {
  Hanging hanging(options(0.01), 5.0, 2.0, rod(2.0), rate_motor(-1.0));
  for (int step = 0; step < 400; ++step) {
    hanging.world.step();
    ASSERT_GT(hanging.length(), 0.02 - kRoundOff);
  }
  EXPECT_NEAR(hanging.length(), 0.02, kRoundOff);
  EXPECT_TRUE(hanging.state().saturated);
  hanging.world.set_motor(hanging.joint, rate_motor(0.5));
  run(hanging.world, 100);
  EXPECT_NEAR(hanging.length(), 0.52, kRoundOff);
  EXPECT_FALSE(hanging.state().saturated);
}

// The load flies on through the anchor when the rope stops, then hangs on the remaining length.
TEST(Motor, WindingInARopeStopsThereToo) {
  Hanging hanging(options(0.01), 5.0, 2.0, rope(2.0), rate_motor(-1.0));
  for (int step = 0; step < 1000; ++step) {
    ASSERT_FALSE(hanging.world.step().outcome.failed);
    ASSERT_LT(hanging.length(), std::max(2.0 - 0.01 * (step + 1), 0.02) + kRoundOff);
  }
  EXPECT_NEAR(hanging.length(), 0.02, kRoundOff);
  EXPECT_TRUE(hanging.state().saturated);
}

// A sinusoid that would wind in too far waits at the end, and goes out from there.
TEST(Motor, SinusoidAtTheEndOfItsTravelStaysFinite) {
  Motor sinusoid;
  sinusoid.amplitude = 10.0;
  sinusoid.frequency = 1.0;
  sinusoid.phase = kPi;
  Hanging hanging(options(0.01), 5.0, 1.0, rod(1.0), sinusoid);
  for (int step = 0; step < 1000; ++step) {
    ASSERT_FALSE(hanging.world.step().outcome.failed);
    ASSERT_GT(hanging.length(), 0.0099);
    ASSERT_LT(hanging.length(), 0.0101 + 10.0 / kPi + 1.0);
  }
}

// A rope 0.5 m too long: wound in for 2.5 s at 0.2 m/s it is taut, then it lifts.
TEST(Motor, WindsARopeInUntilItLifts) {
  Hanging hanging(options(0.01), 5.0, 1.0, rope(1.5), rate_motor(-0.2));
  Body table = make_floor(0.0);
  table.state.position.z() = -1.2;
  hanging.world.remove_body(hanging.load);
  hanging.world.add_body(table);
  hanging.load = hanging.world.add_body(make_body("ball", Sphere{0.2}, 5.0, {0.0, 0.0, -1.0}));
  Joint rope_joint = hang("rope", hanging.load, rope(1.5));
  rope_joint.motor = rate_motor(-0.2);
  hanging.joint = hanging.world.add_joint(rope_joint);
  run(hanging.world, 245);
  EXPECT_EQ(hanging.state().force, 0.0);
  EXPECT_NEAR(hanging.length(), 1.0, 1e-3);  // sinks into the table by its slop, g h²
  run(hanging.world, 155);
  EXPECT_NEAR(hanging.length(), 1.5 - 0.2 * 4.0, kRoundOff);
  EXPECT_NEAR(hanging.state().force, -5.0 * kGravity, 1e-9);
  EXPECT_TRUE(hanging.world.contacts().empty());
}

TEST(Motor, BallJointHasNone) {
  World world(options(0.01));
  const BodyId ball = world.add_body(make_body("ball", Sphere{0.1}, 1.0, Vector3d::Zero()));
  const JointId joint = world.add_joint(hang("joint", ball, JointKind::kBall));
  EXPECT_THROW(world.set_motor(joint, rate_motor(0.1)), std::invalid_argument);
  Joint other = hang("other", ball, JointKind::kBall);
  other.motor.amplitude = 0.1;
  EXPECT_THROW(world.add_joint(other), std::invalid_argument);
  Joint no_length = hang("no_length", ball);  // becomes a ball joint
  no_length.motor.bias = 0.1;
  EXPECT_THROW(world.add_joint(no_length), std::invalid_argument);
  EXPECT_EQ(world.joint_ids().size(), 1u);
}

// ---- springs

struct Oscillator {
  double frequency, damping_ratio, x_0;
  double omega = 2.0 * kPi * frequency;

  /// Returns the closed form for a weightless release at rest from x_0.
  double closed_form(double t) const {
    const double damped = omega * std::sqrt(1.0 - damping_ratio * damping_ratio);
    const double decay = damping_ratio * omega;
    return x_0 * std::exp(-decay * t) *
           (std::cos(damped * t) + decay / damped * std::sin(damped * t));
  }

  Hanging world(double h) const {
    DistanceJoint spring;
    spring.length = 1.0;
    spring.frequency = frequency;
    spring.damping_ratio = damping_ratio;
    return Hanging(weightless(h), 3.0, 1.0 + x_0, spring);
  }
};

// Implicit Euler's own recursion, to rounding: a = −ω² x₁ − 2Dω v₁, v₁ = v₀ + h a, x₁ = x₀ + h v₁.
TEST(Spring, StepIsImplicitEuler) {
  const Oscillator oscillator{1.3, 0.2, 0.3};
  Hanging hanging = oscillator.world(0.01);
  double x = 0.3, v = 0.0;
  const double h = 0.01, w = oscillator.omega;
  for (int step = 0; step < 500; ++step) {
    v = (v - h * w * w * x) / (1.0 + 2.0 * 0.2 * w * h + h * h * w * w);
    x += h * v;
    hanging.world.step();
    EXPECT_NEAR(hanging.state().error, x, kRoundOff);
    EXPECT_NEAR(hanging.state().reached_rate, v, 10.0 * kRoundOff);
  }
}

TEST(Spring, FrequencyAndDampingApproachTheClosedFormWithOrderOne) {
  for (const double damping_ratio : {0.0, 0.3}) {
    const Oscillator oscillator{1.3, damping_ratio, 0.3};
    const std::vector<double> steps{1.0 / 1000.0, 1.0 / 2000.0, 1.0 / 4000.0, 1.0 / 8000.0};
    std::vector<double> errors;
    for (const double h : steps) {
      Hanging hanging = oscillator.world(h);
      run(hanging.world, static_cast<int>(std::lround(1.0 / h)));
      errors.push_back(std::abs(hanging.state().error - oscillator.closed_form(1.0)));
    }
    EXPECT_NEAR(order(steps, errors), 1.0, 0.05);  // the next order is a few % of the first here
    EXPECT_LT(errors.back(), 1e-3);
  }
}

// The joint reports the result of its frequency: k = m ω², c = 2 D m ω, energy ½ k x².
TEST(Spring, FrequencyBecomesStiffnessAndDamping) {
  const Oscillator oscillator{1.3, 0.2, 0.3};
  const Hanging hanging = oscillator.world(0.01);
  const auto joint = hanging.world.joint(hanging.joint).distance;
  const double k = 3.0 * oscillator.omega * oscillator.omega;
  EXPECT_NEAR(joint.stiffness, k, 8 * kEpsilon * k);
  EXPECT_NEAR(joint.damping, 2.0 * 0.2 * 3.0 * oscillator.omega, 8 * kEpsilon * k);
  EXPECT_EQ(joint.frequency, 0.0);
  EXPECT_NEAR(hanging.world.energy(), 0.5 * k * 0.3 * 0.3, 64 * kEpsilon * k);
}

// Two bodies oscillate with their reduced mass, wherever the anchors are.
TEST(Spring, FrequencyIsThatOfTheEffectiveMass) {
  World world(weightless(1e-4));
  Body a = make_body("a", Sphere{0.2}, 1.0, {0.0, 0.0, 0.0});
  Body b = make_body("b", Sphere{0.2}, 3.0, {1.1, 0.0, 0.0});
  const BodyId id_a = world.add_body(a);
  const BodyId id_b = world.add_body(b);
  DistanceJoint soft;
  soft.length = 1.0;
  soft.frequency = 2.0;
  const JointId joint =
      world.add_joint(make_joint("soft", id_a, Vector3d::Zero(), id_b, Vector3d::Zero(), soft));
  run(world, 2500);  // half a period
  // implicit Euler loses π²·f·h = 0.2 % of the amplitude in half a period
  EXPECT_NEAR(world.joint_state(joint).error, -0.1, 0.1 * 0.003);
}

TEST(Spring, StaysBoundedAtAnyStiffness) {
  Hanging hanging(options(0.01), 1.0, 1.1, spring(1.0, 1e12, 0.0));
  for (int step = 0; step < 1000; ++step) {
    ASSERT_FALSE(hanging.world.step().outcome.failed);
    ASSERT_LE(std::abs(hanging.state().error), 0.1);
  }
  EXPECT_NEAR(hanging.state().error, kGravity / 1e12,
              1e-15);                                   // positions of 1 m are rounded to 1e-16
  EXPECT_NEAR(hanging.state().force, -kGravity, 1e-3);  // rounding is 1e-4 N here
}

TEST(Spring, DamperAloneSlowsExponentially) {
  DistanceJoint damper = rod(1.0);
  damper.damping = 2.0;
  Hanging hanging(weightless(0.01), 4.0, 1.0, damper);
  BodyState state = hanging.world.state(hanging.load);
  state.linear_velocity.z() = -1.0;
  hanging.world.set_state(hanging.load, state);
  run(hanging.world, 100);
  EXPECT_NEAR(hanging.state().reached_rate, std::pow(1.0 + 2.0 / 4.0 * 0.01, -100.0), kRoundOff);
}

TEST(Spring, WithALimitStopsThere) {
  DistanceJoint bounded = spring(1.0, 10.0, 0.0);
  bounded.max_length = 1.2;
  Hanging hanging(options(0.01), 5.0, 1.0, bounded);  // alone it would sag by 4.9 m
  run(hanging.world, 500);
  EXPECT_NEAR(hanging.length(), 1.2, 1e-9);
  EXPECT_NEAR(hanging.state().force, -5.0 * kGravity, 1e-6);
}

// The weight pulls the load beyond either limit, which has no row of its own where rows are too
// few.
TEST(Spring, BetweenBothLimitsStopsAtEach) {
  DistanceJoint bounded = spring(1.0, 10.0, 0.0);  // alone it would give way by 4.9 m
  bounded.min_length = 0.8;
  bounded.max_length = 1.2;
  for (const double depth : {1.0, -1.0}) {  // below the origin, and above
    Hanging hanging(options(0.01), 5.0, depth, bounded);
    run(hanging.world, 500);
    EXPECT_NEAR(hanging.length(), depth > 0.0 ? 1.2 : 0.8, 1e-9);
    EXPECT_NEAR(hanging.state().force, (depth > 0.0 ? -5.0 : 5.0) * kGravity, 1e-6);
  }
}

// ---- ropes and struts

TEST(Rope, SlackIsFreeFallExactly) {
  World free_world(options(0.01));
  const BodyId free_body = free_world.add_body(make_body("load", Point{}, 5.0, {0.1, 0.2, -1.0}));
  World roped = free_world;
  const JointId joint = roped.add_joint(hang("rope", free_body, rope(2.0)));
  for (int step = 0; step < 44; ++step) {  // falls by 0.98 m
    free_world.step();
    roped.step();
    ASSERT_EQ(roped.state(free_body).position, free_world.state(free_body).position);
    ASSERT_EQ(roped.state(free_body).linear_velocity, free_world.state(free_body).linear_velocity);
    ASSERT_EQ(roped.joint_state(joint).force, 0.0);
    ASSERT_EQ(roped.joint_state(joint).error, 0.0);
  }
}

TEST(Rope, StopsTheFallAtItsLengthAndHolds) {
  Hanging hanging(options(0.01), 5.0, 1.0, rope(2.0));
  for (int step = 0; step < 1000; ++step) {
    hanging.world.step();
    ASSERT_LT(hanging.length(), 2.0 + kRoundOff);
  }
  EXPECT_NEAR(hanging.length(), 2.0, kRoundOff);
  EXPECT_NEAR(hanging.state().force, -5.0 * kGravity, 1e-9);
}

TEST(Rope, DoesNotPush) {
  Hanging hanging(weightless(0.01), 5.0, 2.0, rope(2.0));
  BodyState state = hanging.world.state(hanging.load);
  state.linear_velocity.z() = 1.0;
  hanging.world.set_state(hanging.load, state);
  run(hanging.world, 100);
  EXPECT_NEAR(hanging.length(), 1.0, kRoundOff);
}

TEST(Strut, HoldsUpButDoesNotHoldDown) {
  Hanging hanging(options(0.01), 5.0, -2.0, between(1.0, kInfinity));  // above the origin
  for (int step = 0; step < 500; ++step) {
    hanging.world.step();
    ASSERT_GT(hanging.length(), 1.0 - kRoundOff);
  }
  EXPECT_NEAR(hanging.length(), 1.0, kRoundOff);
  EXPECT_NEAR(hanging.state().force, 5.0 * kGravity, 1e-9);
  BodyState state = hanging.world.state(hanging.load);
  state.linear_velocity.z() = 3.0;
  hanging.world.set_state(hanging.load, state);
  run(hanging.world, 10);
  EXPECT_GT(hanging.length(), 1.2);
}

TEST(Limits, AreBothKeptHoweverFastTheBodyIs) {
  Hanging hanging(weightless(0.01), 5.0, 1.0, between(0.99, 1.01));
  for (const double velocity : {10.0, -10.0}) {
    BodyState state = hanging.world.state(hanging.load);
    state.position.z() = -1.0 + 5e-4 * velocity;  // near one limit, on the way to the other
    state.linear_velocity.z() = -velocity;
    hanging.world.set_state(hanging.load, state);
    for (int step = 0; step < 20; ++step) {
      hanging.world.step();
      EXPECT_GT(hanging.length(), 0.99 - kRoundOff);
      EXPECT_LT(hanging.length(), 1.01 + kRoundOff);
    }
  }
}

TEST(Limits, OfNoWidthAreARod) {
  Hanging hanging(options(0.01), 5.0, -1.0, between(1.0, 1.0));
  for (int step = 0; step < 100; ++step) {
    hanging.world.step();
    ASSERT_NEAR(hanging.length(), 1.0, kRoundOff);
  }
  EXPECT_NEAR(hanging.state().force, 5.0 * kGravity, 1e-9);
}

// ---- breaking

TEST(Breaking, HoldsBelowAndTearsAbove) {
  Hanging holds(options(0.01), 5.0, 1.0, rod(1.0), {}, 5.0 * kGravity + 0.1);
  run(holds.world, 100);
  EXPECT_FALSE(holds.state().broken);

  Hanging tears(options(0.01), 5.0, 1.0, rod(1.0), {}, 5.0 * kGravity - 0.1);
  tears.world.step();
  EXPECT_TRUE(tears.state().broken);
  EXPECT_NEAR(tears.state().force, -5.0 * kGravity, 1e-9);  // the force that broke the rod
  run(tears.world, 100);
  EXPECT_TRUE(tears.state().broken);
  EXPECT_EQ(tears.state().force, 0.0);
  // free fall from rest for 100 steps after the step in which it broke: g h² Σk
  EXPECT_NEAR(tears.length(), 1.0 + kGravity * 1e-4 * 5050.0, kRoundOff);
  EXPECT_EQ(tears.world.report().costs.rows, 0u);
  EXPECT_FALSE(tears.world.report().joints.worst.has_value());
}

TEST(Breaking, CanBeMendedAndClosesAgain) {
  Hanging hanging(weightless(0.01), 5.0, 1.0, spring(1.0, 100.0, 0.0));
  hanging.world.set_broken(hanging.joint, true);
  BodyState state = hanging.world.state(hanging.load);
  state.linear_velocity.z() = -1.0;
  hanging.world.set_state(hanging.load, state);
  run(hanging.world, 50);
  EXPECT_NEAR(hanging.world.energy(), 2.5, kRoundOff);  // ½ m v²
  hanging.world.set_broken(hanging.joint, false);
  EXPECT_NEAR(hanging.state().error, 0.5, kRoundOff);
  EXPECT_NEAR(hanging.world.energy(), 2.5 + 12.5, 100 * kRoundOff);  // plus ½ k x²
}

TEST(Breaking, MendedRodIsClosing) {
  Hanging hanging(weightless(0.01), 5.0, 1.0, rod(1.0));
  hanging.world.set_broken(hanging.joint, true);
  BodyState state = hanging.world.state(hanging.load);
  state.position.z() = -2.0;
  hanging.world.set_state(hanging.load, state);
  hanging.world.set_broken(hanging.joint, false);
  EXPECT_TRUE(hanging.state().closing);
  run(hanging.world, 100);
  EXPECT_FALSE(hanging.state().closing);
}

// ---- errors left by edits, closed smoothly

WorldOptions closing_options(double time_step) {
  WorldOptions options = weightless(time_step);
  options.method = Method::kAuto;
  options.closing_time = 0.4;
  return options;
}

// 1 − 10u³ + 15u⁴ − 6u⁵, written out, unlike the nested form in the engine.
double quintic(double u) {
  return u >= 1.0 ? 0.0
                  : 1.0 - 10.0 * std::pow(u, 3) + 15.0 * std::pow(u, 4) - 6.0 * std::pow(u, 5);
}

TEST(Closing, ABallJointOffElsewhereThanItMayBeDoesNotFit) {
  Joint joint;
  joint.kind = JointKind::kBall;
  BodyState a, b;
  b.position = {0.01, 0.0, 0.0};
  JointData state;
  begin_joint(joint, a, b, 0.0, state);
  const JointStep start{0.0, 0.01, 0.1, 0.4};
  EXPECT_TRUE(fits(joint, a, b, start, state));
  b.position = {0.0, 0.01, 0.0};
  EXPECT_FALSE(fits(joint, a, b, start, state));
}

TEST(Closing, IsPartOfTheStateThatIsHashed) {
  Hanging hanging(closing_options(0.01), 5.0, 1.5, rod(1.0));
  hanging.world.step();
  World again = hanging.world;  // nothing moves, but closing restarts
  for (const BodyId id : again.body_ids()) again.set_state(id, again.state(id));
  EXPECT_NE(again.state_hash(), hanging.world.state_hash());
}

TEST(Closing, ARodTooShortClosesByTheQuintic) {
  for (const double h : {0.01, 0.003}) {
    Hanging hanging(closing_options(h), 5.0, 1.5, rod(1.0));
    EXPECT_TRUE(hanging.state().closing);
    const auto steps = static_cast<int>(std::ceil(0.4 / h));
    for (int n = 1; n <= steps; ++n) {
      EXPECT_TRUE(hanging.state().closing);
      hanging.world.step();
      // the load moves along the rod, so velocity and position meet the target to rounding
      EXPECT_NEAR(hanging.state().error, 0.5 * quintic(n * h / 0.4), kRoundOff);
    }
    EXPECT_FALSE(hanging.state().closing);
    hanging.world.step();
    EXPECT_NEAR(hanging.world.state(hanging.load).linear_velocity.norm(), 0.0, 1e-10);
  }
}

TEST(Closing, SpeedNeverExceedsThatOfTheQuintic) {
  Hanging hanging(closing_options(0.001), 5.0, 2.0, rod(1.0));
  double fastest = 0.0;
  for (int n = 0; n < 500; ++n) {
    hanging.world.step();
    fastest = std::max(fastest, hanging.world.state(hanging.load).linear_velocity.norm());
  }
  EXPECT_NEAR(fastest, 15.0 / 8.0 * 1.0 / 0.4, 1e-3);  // slope sampled every 1/400
}

TEST(Closing, ABallJointClosesInAStraightLine) {
  World world(closing_options(0.01));
  const BodyId body = world.add_body(make_body("b", Point{}, 1.0, {0.3, -0.4, 1.2}));
  Joint joint = hang("ball", body, JointKind::kBall);
  const JointId id = world.add_joint(joint);
  for (int n = 1; n <= 40; ++n) {
    world.step();
    const Vector3d expected = quintic(n / 40.0) * Vector3d(0.3, -0.4, 1.2);
    EXPECT_LT((world.state(body).position - expected).norm(), kRoundOff);
  }
  EXPECT_FALSE(world.joint_state(id).closing);
}

TEST(Closing, ARopeTooShortClosesAndAStrutTooLong) {
  for (const bool is_rope : {true, false}) {
    Hanging hanging(closing_options(0.01), 5.0, 1.0, is_rope ? rope(0.7) : between(1.3, kInfinity));
    run(hanging.world, 20);
    EXPECT_NEAR(std::abs(hanging.state().error), 0.15,
                kRoundOff);  // half of the error in half the time
    run(hanging.world, 20);
    EXPECT_NEAR(hanging.state().error, 0.0, kRoundOff);
  }
}

TEST(Closing, SettingABodyElsewhereBeginsAnew) {
  Hanging hanging(closing_options(0.01), 5.0, 1.0, rod(1.0));
  EXPECT_FALSE(hanging.state().closing);
  run(hanging.world, 10);
  BodyState state = hanging.world.state(hanging.load);
  state.position *= 1.25;
  hanging.world.set_state(hanging.load, state);
  run(hanging.world, 20);
  EXPECT_NEAR(hanging.state().error, 0.125, kRoundOff);
  run(hanging.world, 20);
  EXPECT_NEAR(hanging.state().error, 0.0, kRoundOff);
}

TEST(Breaking, LetsItsBodiesCollide) {
  World world(weightless(0.01));
  const BodyId a = world.add_body(make_body("a", Sphere{0.5}, 1.0, {0.0, 0.0, 0.0}));
  const BodyId b = world.add_body(make_body("b", Sphere{0.5}, 1.0, {0.9, 0.0, 0.0}));
  Joint joint = make_joint("rod", a, Vector3d::Zero(), b, Vector3d::Zero());
  joint.break_force = 10.0;
  const JointId id = world.add_joint(joint);
  run(world, 5);
  EXPECT_EQ(world.report().contacts.points, 0u);
  BodyState state = world.state(b);
  state.linear_velocity.x() = 1.0;  // stopping half of the mass takes 50 N
  world.set_state(b, state);
  world.step();
  EXPECT_TRUE(world.joint_state(id).broken);
  world.step();
  EXPECT_EQ(world.report().contacts.points, 1u);
}

// ---- joints of zero length

TEST(NoLength, AskedForOrFoundIsABallJoint) {
  World world(options(0.01));
  const BodyId a = world.add_body(make_body("a", Sphere{0.1}, 1.0, {1.0, 2.0, 3.0}));
  const Vector3d here(1.0, 2.0, 3.0);
  const auto type_of = [&](const Joint& joint) {
    return std::string(name(world.joint(world.add_joint(joint)).kind));
  };
  EXPECT_EQ(
      type_of(make_joint("zero", kWorldBody, Vector3d::Zero(), a, Vector3d::Zero(), rod(0.0))),
      "ball");
  EXPECT_EQ(type_of(make_joint("found", kWorldBody, here, a, Vector3d::Zero())), "ball");
  EXPECT_EQ(type_of(make_joint("apart", kWorldBody, Vector3d::Zero(), a, Vector3d::Zero())),
            "distance");
  EXPECT_EQ(
      type_of(make_joint("soft", kWorldBody, here, a, Vector3d::Zero(), spring(0.0, 9.0, 0.0))),
      "distance");
}

// A ball joint requested at a distance pulls the point in: a share β of the error each step.
TEST(NoLength, BallJointClosesItsError) {
  World world(weightless(0.01));
  const BodyId a = world.add_body(make_body("a", Point{}, 1.0, {0.3, 0.4, 1.2}));
  const JointId joint = world.add_joint(hang("ball", a, rod(0.0)));
  EXPECT_NEAR(world.joint_state(joint).error, 1.3, kRoundOff);
  for (int step = 1; step <= 50; ++step) {
    world.step();
    EXPECT_NEAR(world.joint_state(joint).error, 1.3 * std::pow(0.9, step), kRoundOff);
  }
}

TEST(NoLength, SpringOfNoLengthRestsInItsAnchor) {
  Hanging hanging(options(0.01), 1.0, 0.0, spring(0.0, 100.0, 20.0));
  run(hanging.world, 1000);
  EXPECT_LT(hanging.length(), 1.0);  // bounded only, since there is no direction at zero
}

// Anchors of a rod moved to one point: a direction is chosen, never NaN.
TEST(Coincident, RodAtRunTimeOpensAgain) {
  World world(weightless(0.01));
  const BodyId a = world.add_body(make_body("a", Point{}, 1.0, {0.0, 0.0, 0.0}));
  const BodyId b = world.add_body(make_body("b", Point{}, 2.0, {0.0, 1.0, 0.0}));
  const JointId joint =
      world.add_joint(make_joint("rod", a, Vector3d::Zero(), b, Vector3d::Zero()));
  world.set_state(b, world.state(a));
  for (int step = 1; step <= 100; ++step) {
    ASSERT_FALSE(world.step().outcome.failed);
    EXPECT_NEAR(world.joint_state(joint).error, -std::pow(0.9, step), kRoundOff);
  }
}

TEST(Coincident, RodOfALengthCanBeAddedThere) {
  WorldOptions awake = weightless(0.01);
  awake.sleep_after = kInfinity;  // Baumgarte closes ever less
  World world(awake);
  const BodyId a = world.add_body(make_body("a", Point{}, 1.0, Vector3d::Zero()));
  const JointId joint = world.add_joint(hang("rod", a, rod(1.0)));
  EXPECT_EQ(world.joint_state(joint).error, -1.0);
  run(world, 300);
  EXPECT_NEAR(distance(world, joint), 1.0, kRoundOff);
}

}  // namespace
}  // namespace constraint_sim::engine
