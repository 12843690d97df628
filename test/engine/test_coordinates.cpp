// Laws on the free coordinates of joints: motors, springs, dampers, forces, limits and friction, of
// translations and angles, by each method against closed forms.

#include "constraint_sim/engine/scene.h"
#include "engine/constraints/joint_kinds.h"
#include "engine/constraints/law.h"
#include "random_joints.h"
#include "shipped_scenes.h"
#include "support.h"

namespace constraint_sim::engine {
namespace {

using Eigen::Quaterniond;
using Eigen::Vector3d;

// κ and Δφ, by their end, against fourth-order differences over 1e-3, whose error is 1e-12 of a
// fifth derivative of a few hundred.
TEST(AngleForms, StepsHaveTheirDerivatives) {
  constexpr double kStep = 1e-3;
  for (const double turn : {-2.5, -1.0, -1e-4, 0.0, 1e-5, 0.3, 1.5, 2.8}) {
    const CosineAndSine<double> start{std::cos(0.4), std::sin(0.4)};
    const auto at = [&](double c, double s) {
      const double radius = 1.1;  // off the constraint
      return AngleStep(start,
                       {radius * std::cos(0.4 + turn) + c, radius * std::sin(0.4 + turn) + s});
    };
    const auto slope = [&](double AngleStep::*of, bool by_c) {
      const auto f = [&](double t) { return by_c ? at(t, 0.0).*of : at(0.0, t).*of; };
      return (8.0 * (f(kStep) - f(-kStep)) - (f(2.0 * kStep) - f(-2.0 * kStep))) / (12.0 * kStep);
    };
    const AngleStep step = at(0.0, 0.0);
    EXPECT_NEAR(step.change, turn, 1e-14);
    EXPECT_NEAR(step.change_c, slope(&AngleStep::change, true), 1e-10) << turn;
    EXPECT_NEAR(step.change_s, slope(&AngleStep::change, false), 1e-10) << turn;
    // κ grows as 1/sin near half a turn, and its derivatives faster
    const double scale = 1.0 / std::pow(std::cos(0.5 * turn), 6.0);
    EXPECT_NEAR(step.kappa_c, slope(&AngleStep::kappa, true), 1e-9 * scale) << turn;
    EXPECT_NEAR(step.kappa_s, slope(&AngleStep::kappa, false), 1e-9 * scale) << turn;
  }
}

/// A bar of 1 m and 2 kg on a hinge at its end, about z, weightless by default. Its moment of
/// inertia about the hinge is kBarInertia.
constexpr double kBarMass = 2.0, kBarArm = 0.5;
constexpr double kBarInertia = kBarMass * (1.0 + 0.01) / 12.0 + kBarMass * kBarArm * kBarArm;

struct Bar {
  World world;
  BodyId body{};
  JointId hinge{};

  Bar(Method method, double h, const CoordinateLaw& law, double spin = 0.0, double gravity = 0.0,
      double tolerance = 1e-11)
      : world([&] {
          WorldOptions chosen = options(h, gravity);
          chosen.method = method;
          chosen.tolerance = tolerance;
          return chosen;
        }()) {
    Body bar = make_body("bar", Box{{1.0, 0.1, 0.1}}, kBarMass, {kBarArm, 0.0, 0.0});
    bar.state.angular_velocity = {0.0, 0.0, spin};
    bar.state.linear_velocity = {0.0, kBarArm * spin, 0.0};
    bar.no_collision = true;
    body = world.add_body(bar);
    Joint joint = make_joint("hinge", kWorldBody, Vector3d::Zero(), body, {-kBarArm, 0.0, 0.0},
                             JointKind::kHinge);
    joint.coordinates[0] = law;
    hinge = world.add_joint(joint);
  }

  const CoordinateState& angle() const { return world.joint_state(hinge).coordinates[0]; }
  void run(double time) {
    const int steps = static_cast<int>(std::lround(time / world.options().time_step));
    for (int i = 0; i < steps; ++i) ASSERT_FALSE(world.step().outcome.failed);
  }
};

CoordinateLaw driven(double bias, double amplitude = 0.0, double frequency = 0.0) {
  CoordinateLaw law;
  law.motor.emplace();
  law.motor->bias = bias;
  law.motor->amplitude = amplitude;
  law.motor->frequency = frequency;
  return law;
}

// q(t) = ∫ζ for any tick, counting whole turns, to the rounding of 80 rad in 1000 sums.
TEST(AngleMotor, IsExactAndCountsTurns) {
  for (const Method method : kSmoothMethods) {
    for (const double h : {0.1, 0.01, 0.002}) {
      if (method == Method::kEnergyMomentum && h > 0.04) continue;  // at most two radians a tick
      Bar bar(method, h, driven(40.0, 3.0, 1.5));
      bar.run(2.0);
      const double omega = 2.0 * kPi * 1.5;
      const double expected = 80.0 + 3.0 / omega * (1.0 - std::cos(omega * 2.0));
      EXPECT_NEAR(bar.angle().position, expected, 1e-12) << name(method) << h;
      if (method == Method::kRungeKutta) {
        EXPECT_NEAR(bar.angle().velocity, 40.0 + 3.0 * std::sin(omega * 2.0), 1e-11);
      }
      EXPECT_LE(bar.world.report().joints.max_error, 1e-13);
      EXPECT_EQ(bar.world.report().energy.rise, 0.0);
    }
  }
}

// The motor's rate jumps while its sinusoid continues: the bodies then get an impulse, instead of a
// projection of an overshoot. The jump is not at the end of a tick.
TEST(AngleMotor, EndsInTimeWhileItsSinusoidGoesOn) {
  const auto end = [](Method method, double h) {
    CoordinateLaw law = driven(2.0, 1.0, 1.5);
    law.motor->timeout = 0.155;
    Bar bar(method, h, law, 0.0, kGravity);
    Body hung = make_body("hung", Box{{0.2, 0.6, 0.1}}, 1.0, {1.0, -0.3, 0.0});
    hung.no_collision = true;
    const BodyId last = bar.world.add_body(hung);
    bar.world.add_joint(
        make_joint("ball", bar.body, {kBarArm, 0.0, 0.0}, last, {0.0, 0.3, 0.0}, JointKind::kBall));
    const int steps = static_cast<int>(std::lround(0.4 / h));
    for (int i = 0; i < steps; ++i) {
      EXPECT_FALSE(bar.world.step().outcome.failed);
      EXPECT_LE(bar.world.report().joints.max_error, 1e-12) << name(method) << h;
    }
    EXPECT_NEAR(bar.angle().position, 0.31 + (1.0 - std::cos(3.0 * kPi * 0.4)) / (3.0 * kPi),
                1e-12);
    return bar.world.state(last).position;
  };
  const Vector3d exact = end(Method::kRungeKutta, 0.001);
  EXPECT_LE((end(Method::kRungeKutta, 0.1) - exact).norm(), 1e-8);
  EXPECT_LE((end(Method::kEnergyMomentum, 0.002) - exact).norm(), 1e-6);
}

// sequential_impulses is of first order, since it closes a share of the error.
TEST(AngleMotor, IsFollowedByImpulses) {
  Bar bar(Method::kSequentialImpulses, 0.001, driven(3.0));
  bar.run(1.0);
  EXPECT_NEAR(bar.angle().position, 3.0, 1e-3);
  EXPECT_NEAR(bar.angle().velocity, 3.0, 1e-3);
}

// I φ̈ = −k (φ − r) − c φ̇: order 8 to its tolerance, order 4 at 1/500 s, impulses at first order.
TEST(TorsionSpring, SwingsAsTheDampedOscillator) {
  const double k = 30.0, D = 0.1, rest = 0.7;
  const double omega = std::sqrt(k / kBarInertia), decay = D * omega;
  const double damped = std::sqrt(1.0 - D * D) * omega;
  CoordinateLaw law;
  law.stiffness = k;
  law.damping = 2.0 * D * omega * kBarInertia;
  law.rest = rest;
  const double t = 1.0;
  const double expected = rest - rest * std::exp(-decay * t) *
                                     (std::cos(damped * t) + decay / damped * std::sin(damped * t));
  for (const auto& [method, h, tolerance] : {std::tuple(Method::kRungeKutta, 0.02, 1e-10),
                                             {Method::kRungeKutta, 0.1, 1e-10},
                                             {Method::kEnergyMomentum, 0.0005, 2e-7},
                                             {Method::kSequentialImpulses, 0.001, 2e-2}}) {
    Bar bar(method, h, law);
    bar.run(t);
    EXPECT_NEAR(bar.angle().position, expected, tolerance) << name(method);
  }
}

TEST(TorsionSpring, ByFrequencyGoesByTheMomentAboutTheHinge) {
  CoordinateLaw law;
  law.frequency = 2.0;
  law.damping_ratio = 0.1;
  Bar bar(Method::kRungeKutta, 0.01, law);
  const CoordinateLaw& filled = bar.world.joint(bar.hinge).coordinates[0];
  const double omega = 2.0 * kPi * 2.0;
  EXPECT_NEAR(filled.stiffness, omega * omega * kBarInertia, 1e-12 * filled.stiffness);
  EXPECT_NEAR(filled.damping, 0.2 * omega * kBarInertia, 1e-12 * filled.damping);
}

// A spring wound up by several turns keeps its energy, and swings back through them.
TEST(TorsionSpring, WindsUpOverWholeTurns) {
  CoordinateLaw law;
  law.stiffness = 1.0;
  const double spin = 30.0, omega = std::sqrt(law.stiffness / kBarInertia);
  for (const auto& [method, h, tolerance] :
       {std::tuple(Method::kRungeKutta, 0.02, 1e-8), {Method::kEnergyMomentum, 0.001, 1e-4}}) {
    Bar bar(method, h, law, spin);
    const double energy = bar.world.energy();
    double most = 0.0;
    for (int i = 0; i < static_cast<int>(std::lround(4.0 / h)); ++i) {
      bar.world.step();
      most = std::max(most, bar.angle().position);
      ASSERT_NEAR(bar.angle().position, spin / omega * std::sin(omega * bar.world.time()),
                  tolerance);
      ASSERT_NEAR(bar.world.energy(), energy, 1e-9 * energy);
    }
    EXPECT_GT(most, 20.0);
  }
}

TEST(AngleMotor, ActsWithAConstantForce) {
  CoordinateLaw law;
  law.motor.emplace();
  law.motor->force = 1.5;
  for (const auto& [method, tolerance] : {std::pair(Method::kRungeKutta, 1e-10),
                                          {Method::kEnergyMomentum, 1e-9},
                                          {Method::kSequentialImpulses, 0.03}}) {
    Bar bar(method, 0.01, law);
    bar.run(1.0);
    EXPECT_NEAR(bar.angle().position, 0.5 * 1.5 / kBarInertia, tolerance) << name(method);
    EXPECT_NEAR(bar.angle().effort, 1.5, 1e-9) << name(method);
    EXPECT_EQ(bar.world.report().energy.rise, 0.0);
  }
}

TEST(AngleMotor, GoesToAPositionWithinTheClosingTimeAndHoldsIt) {
  CoordinateLaw law;
  law.motor.emplace();
  law.motor->position = 1.2;
  for (const auto& [method, tolerance] : {std::pair(Method::kRungeKutta, 1e-13),
                                          {Method::kEnergyMomentum, 1e-13},
                                          {Method::kSequentialImpulses, 2e-2}}) {
    Bar bar(method, 0.01, law, 0.0, kGravity);
    EXPECT_TRUE(bar.world.joint_state(bar.hinge).closing);
    bar.run(0.25);  // half the time, and half the way
    if (method != Method::kSequentialImpulses) {
      EXPECT_NEAR(bar.angle().position, 0.6, 1e-12);
    }
    bar.run(0.5);
    EXPECT_NEAR(bar.angle().position, 1.2, tolerance) << name(method);
    EXPECT_NEAR(bar.world.joint_state(bar.hinge).error, 0.0, tolerance);
  }
}

// A servo of 3 Hz and damping ratio 1: φ = p (1 − (1 + ωt) e^(−ωt)).
TEST(AngleMotor, ServosToAPosition) {
  CoordinateLaw law;
  law.motor.emplace();
  law.motor->position = 1.0;
  law.motor->servo_frequency = 3.0;
  const double omega = 2.0 * kPi * 3.0, t = 0.1;
  const double expected = 1.0 - (1.0 + omega * t) * std::exp(-omega * t);
  for (const auto& [method, h, tolerance] : {std::tuple(Method::kRungeKutta, 0.01, 1e-10),
                                             {Method::kEnergyMomentum, 0.0005, 1e-6},
                                             {Method::kSequentialImpulses, 0.0005, 2e-2}}) {
    Bar bar(method, h, law);
    bar.run(t);
    EXPECT_NEAR(bar.angle().position, expected, tolerance) << name(method);
  }
}

TEST(AngleLimits, HoldAtTheirEnds) {
  CoordinateLaw law;
  law.lower = -0.5;
  law.upper = 0.25;
  Bar bar(Method::kAuto, 0.002, law, 2.0);
  EXPECT_EQ(bar.world.islands().front().why, MethodReason::kLimit);
  double most = 0.0, least = 0.0;
  for (int i = 0; i < 1000; ++i) {
    bar.world.step();
    most = std::max(most, bar.angle().position);
    least = std::min(least, bar.angle().position);
    ASSERT_EQ(bar.world.report().energy.rise, 0.0);
  }
  EXPECT_NEAR(most, 0.25, 1e-12);
  EXPECT_GE(least, -0.5 - 1e-12);
  EXPECT_NEAR(bar.angle().velocity, 0.0, 1e-12);  // without restitution it stays
}

TEST(AngleLimits, ThrowBackWithTheirShareOfTheSpeed) {
  CoordinateLaw law;
  law.upper = 0.25;
  law.limit_restitution = 0.5;
  Bar bar(Method::kAuto, 0.001, law, 2.0);
  bar.run(0.3);
  EXPECT_NEAR(bar.angle().velocity, -1.0, 1e-12);
}

// Coulomb friction decelerates by τ/I, and then holds.
TEST(AngleFriction, BrakesEvenlyAndHolds) {
  CoordinateLaw law;
  law.friction = 0.5;
  Bar bar(Method::kAuto, 0.001, law, 1.0);
  EXPECT_EQ(bar.world.islands().front().why, MethodReason::kFriction);
  bar.run(0.5);
  EXPECT_NEAR(bar.angle().velocity, 1.0 - 0.5 / kBarInertia * 0.5, 1e-12);
  bar.run(2.0);
  EXPECT_NEAR(bar.angle().velocity, 0.0, 1e-12);
}

TEST(AngleMotor, GivesWayAtItsForceLimit) {
  CoordinateLaw law = driven(5.0);
  law.motor->max_force = 0.6;
  Bar bar(Method::kAuto, 0.001, law);
  EXPECT_EQ(bar.world.islands().front().why, MethodReason::kForceLimit);
  bar.run(0.4);
  EXPECT_TRUE(bar.world.joint_state(bar.hinge).saturated);
  EXPECT_NEAR(bar.angle().velocity, 0.6 / kBarInertia * 0.4, 1e-12);
  EXPECT_NEAR(bar.angle().effort, 0.6, 1e-9);
}

// The crank of a slider-crank from rest: its motor is saturated, also where closing errors of other
// rows reduces its impulse slightly.
TEST(AngleMotor, TellsItsForceLimitByImpulses) {
  World world = shipped("slider_crank", Method::kSequentialImpulses);
  const JointId shaft = world.find_joint("shaft");
  Motor motor;
  motor.bias = 6.0;
  motor.max_force = 5.0;
  world.set_motor(shaft, 0, motor);
  int at_limit = 0, with_corrections = 0;
  for (int i = 0; i < 200; ++i) {
    world.step();
    const JointState& state = world.joint_state(shaft);
    EXPECT_LE(std::abs(state.force), 5.0 * (1.0 + 1e-12));
    if (std::abs(state.force) < 5.0 * (1.0 - 1e-6)) continue;
    ++at_limit;
    if (std::abs(state.force) < 5.0) ++with_corrections;
    EXPECT_TRUE(state.saturated) << i;
  }
  EXPECT_GT(at_limit, 100);
  EXPECT_GT(with_corrections, 0);
}

// Servos and forces report saturation like rate motors.
TEST(AngleMotor, TellsTheForceLimitOfAServoAndOfAForce) {
  CoordinateLaw servo;
  servo.motor.emplace();
  servo.motor->position = 1.0;
  servo.motor->servo_stiffness = 2.0;
  servo.motor->servo_damping = 2.0;
  servo.motor->max_force = 0.6;
  Bar bar(Method::kSequentialImpulses, 0.001, servo);
  bar.run(0.1);
  EXPECT_TRUE(bar.world.joint_state(bar.hinge).saturated);
  EXPECT_NEAR(bar.angle().effort, 0.6, 1e-9);
  bar.run(4.9);
  EXPECT_FALSE(bar.world.joint_state(bar.hinge).saturated);
  for (const double force : {0.5, 0.7}) {
    CoordinateLaw law;
    law.motor.emplace();
    law.motor->force = force;
    law.motor->max_force = 0.6;
    Bar pushed(Method::kSequentialImpulses, 0.001, law);
    pushed.run(0.1);
    EXPECT_EQ(pushed.world.joint_state(pushed.hinge).saturated, force > 0.6);
  }
}

TEST(AngleMotor, IsSetAndReleasedWhileRunning) {
  for (const Method method : kSmoothMethods) {
    Bar bar(method, 0.01, CoordinateLaw{}, 1.0);
    bar.run(0.5);
    EXPECT_NEAR(bar.angle().position, 0.5, 1e-9);
    Motor motor;
    motor.bias = -2.0;
    bar.world.set_motor(bar.hinge, motor);
    bar.run(0.5);
    EXPECT_NEAR(bar.angle().position, -0.5, 1e-9);
    bar.world.set_motor(bar.hinge, Motor{});
    bar.run(0.5);  // held
    EXPECT_NEAR(bar.angle().position, -0.5, 1e-9);
    bar.world.set_motor(bar.hinge, 0, std::nullopt);
    Wrench twist;
    twist.body = bar.body;
    twist.torque = {0.0, 0.0, 1.0};
    bar.world.add_wrench(twist);
    bar.run(0.5);
    EXPECT_GT(bar.angle().position, -0.45);  // free again
  }
}

TEST(SliderLaws, AreThoseOfATranslation) {
  const double k = 50.0, m = 3.0, t = 1.0;
  for (const auto& [method, h, tolerance] :
       {std::tuple(Method::kRungeKutta, 0.02, 1e-10), {Method::kEnergyMomentum, 0.0005, 2e-7}}) {
    WorldOptions chosen = options(h);
    chosen.method = method;
    chosen.tolerance = 1e-11;
    World world(chosen);
    Body cart = make_body("cart", Box{{0.2, 0.3, 0.4}}, m, {0.1, 0.2, 0.3});
    const BodyId id = world.add_body(cart);
    Joint slider =
        make_joint("slider", kWorldBody, {0.1, 0.2, 0.3}, id, Vector3d::Zero(), JointKind::kSlider);
    slider.coordinates[0].stiffness = k;
    slider.coordinates[0].position = 0.5;  // value in the initial pose
    slider.coordinates[0].rest = 0.5;
    const JointId joint = world.add_joint(slider);
    for (int i = 0; i < static_cast<int>(std::lround(t / h)); ++i) world.step();
    const double sag = -m * kGravity / k;
    EXPECT_NEAR(world.joint_state(joint).coordinates[0].position,
                0.5 + sag * (1.0 - std::cos(std::sqrt(k / m) * t)), tolerance);
  }
}

// Wrench at the hinge of a bar that hangs straight down: its weight, and no torque; of a bar that a
// motor holds level: m g times the arm.
TEST(JointWrench, IsTheWeightAndItsMoment) {
  for (const Method method : {Method::kRungeKutta, Method::kEnergyMomentum}) {
    WorldOptions chosen = options(0.01);
    chosen.method = method;
    World world(chosen);
    const BodyId id =
        world.add_body(make_body("bar", Box{{1.0, 0.1, 0.1}}, kBarMass, {kBarArm, 0, 0}));
    Joint joint = make_joint("hinge", kWorldBody, Vector3d::Zero(), id, {-kBarArm, 0.0, 0.0},
                             JointKind::kHinge);
    joint.frame_a = frame_along(Vector3d::UnitY());
    joint.coordinates[0].motor.emplace();
    const JointId hinge = world.add_joint(joint);
    world.step();
    const World::JointWrench wrench = world.joint_wrench(hinge);
    EXPECT_NEAR(wrench.force.norm(), kBarMass * kGravity, 1e-9);
    // gravity turns the bar positively about y, and the joint resists
    EXPECT_NEAR(wrench.torque.z(), -kBarMass * kGravity * kBarArm, 1e-9);
    EXPECT_NEAR(world.joint_state(hinge).force, -kBarMass * kGravity * kBarArm, 1e-9);
  }
}

TEST(JointBreak, TearsByTorque) {
  for (const Method method : {Method::kRungeKutta, Method::kSequentialImpulses}) {
    for (const double share : {0.9, 1.1}) {
      WorldOptions chosen = options(0.01);
      chosen.method = method;
      World world(chosen);
      const BodyId id =
          world.add_body(make_body("bar", Box{{1.0, 0.1, 0.1}}, kBarMass, {kBarArm, 0, 0}));
      Joint weld = make_joint("weld", kWorldBody, Vector3d::Zero(), id, {-kBarArm, 0.0, 0.0},
                              JointKind::kWeld);
      weld.break_torque = share * kBarMass * kGravity * kBarArm;
      const JointId joint = world.add_joint(weld);
      for (int i = 0; i < 20; ++i) world.step();
      EXPECT_EQ(world.joint_state(joint).broken, share < 1.0) << name(method);
    }
  }
}

/// Two boxes in free space in a joint with a spring along each of its coordinates.
class SpringsOfEachKind : public testing::TestWithParam<JointKind> {};

World sprung_pair(JointKind kind, Method method, double h) {
  Random random;
  WorldOptions chosen = weightless(h);
  chosen.method = method;
  chosen.tolerance = 1e-11;
  Joint joint = random_joint(kind, &random);
  joint.anchor_a *= 0.4;
  joint.anchor_b *= 0.4;
  for (int i = 0; i < info(kind).coordinates; ++i) {
    joint.coordinates[static_cast<std::size_t>(i)].stiffness = 20.0;
    joint.coordinates[static_cast<std::size_t>(i)].rest = 0.2;
  }
  World world(chosen);
  Body a = make_body("a", Box{{0.3, 0.5, 0.9}}, 2.0, Vector3d::Zero());
  Body b = make_body("b", Box{{0.8, 0.2, 0.4}}, 3.0, Vector3d::Zero());
  a.state = random.state();
  b.state = attached(joint, a.state, &random);
  b.state.linear_velocity =
      a.state.linear_velocity + a.state.angular_velocity.cross(b.state.position - a.state.position);
  b.state.angular_velocity = a.state.angular_velocity;
  a.no_collision = b.no_collision = true;
  joint.body_a = world.add_body(a);
  joint.body_b = world.add_body(b);
  world.add_joint(joint);
  return world;
}

TEST_P(SpringsOfEachKind, KeepEnergyAndMomenta) {
  for (const Method method : kSmoothMethods) {
    World world = sprung_pair(GetParam(), method, 0.01);
    world.step();
    const double energy = world.energy();
    const Vector3d p = momentum(world), L = angular_momentum(world);
    for (int i = 0; i < 300; ++i) {
      const StepReport& report = world.step();
      ASSERT_FALSE(report.outcome.failed);
      ASSERT_LE(report.joints.max_error, 1e-13) << name(method);
      ASSERT_EQ(report.costs.method_changes, 0u) << name(method);
    }
    // energy_momentum to rounding of 300 steps, runge_kutta to its tolerance at a few m/s
    const bool is_exact = method == Method::kEnergyMomentum;
    EXPECT_NEAR(world.energy(), energy, (is_exact ? 5e-11 : 1e-8) * energy) << name(method);
    EXPECT_LE((momentum(world) - p).norm(), 1e-12 * p.norm()) << name(method);
    EXPECT_LE((angular_momentum(world) - L).norm(), (is_exact ? 1e-11 : 1e-8) * L.norm());
  }
}

TEST_P(SpringsOfEachKind, MoveAlikeByEachMethod) {
  World exact = sprung_pair(GetParam(), Method::kRungeKutta, 0.01);
  World implicit = sprung_pair(GetParam(), Method::kEnergyMomentum, 0.001);
  World impulses = sprung_pair(GetParam(), Method::kSequentialImpulses, 0.0005);
  for (int i = 0; i < 50; ++i) exact.step();
  for (int i = 0; i < 500; ++i) implicit.step();
  for (int i = 0; i < 1000; ++i) impulses.step();
  for (const BodyId id : exact.body_ids()) {
    const auto off = [&](const World& other) {
      return std::max((exact.state(id).position - other.state(id).position).norm(),
                      exact.state(id).orientation.angularDistance(other.state(id).orientation));
    };
    EXPECT_LE(off(implicit), 1e-6);
    EXPECT_LE(off(impulses), 2e-2);
  }
}

TEST_P(SpringsOfEachKind, AreSavedAndLoadedAsTheyAre) {
  for (const Method method : {Method::kRungeKutta, Method::kSequentialImpulses}) {
    World world = sprung_pair(GetParam(), method, 0.01);
    for (int i = 0; i < 20; ++i) world.step();
    const std::string saved = save_scene(world);
    World loaded = load_scene(saved, "saved");
    EXPECT_EQ(save_scene(loaded), saved);
    for (int i = 0; i < 20; ++i) {
      world.step();
      loaded.step();
    }
    for (const BodyId id : world.body_ids())
      EXPECT_LE((world.state(id).position - loaded.state(id).position).norm(), 1e-8);
    if (method == Method::kSequentialImpulses) {
      EXPECT_EQ(world.state_hash(), loaded.state_hash());
    }
  }
}

std::vector<JointKind> kinds_with_coordinates() {
  std::vector<JointKind> kinds;
  for (const JointKind kind : joint_kinds())
    if (info(kind).coordinates > 0) kinds.push_back(kind);
  return kinds;
}

INSTANTIATE_TEST_SUITE_P(JointKinds, SpringsOfEachKind, testing::ValuesIn(kinds_with_coordinates()),
                         [](const auto& kind) { return std::string(name(kind.param)); });

// Two motors on one shaft with different target rates contradict each other, which is reported.
TEST(AngleMotors, ThatContradictAreTold) {
  Bar bar(Method::kAuto, 0.01, driven(1.0));
  Joint second = bar.world.joint(bar.hinge);
  second.name = "second";
  second.coordinates[0].motor->bias = 2.0;
  bar.world.add_joint(second);
  bool is_conflict = false;
  for (int i = 0; i < 50; ++i) {
    bar.world.step();
    is_conflict = is_conflict || bar.world.islands().front().why == MethodReason::kInconsistent;
  }
  EXPECT_TRUE(is_conflict);
  EXPECT_GT(bar.world.report().joints.max_error, 1e-3);
  EXPECT_FALSE(bar.world.report().outcome.failed);
}

TEST(AngleMotors, ThatAgreeAreRedundant) {
  Bar bar(Method::kAuto, 0.01, driven(1.0));
  Joint second = bar.world.joint(bar.hinge);
  second.name = "second";
  bar.world.add_joint(second);
  for (int i = 0; i < 50; ++i) ASSERT_LE(bar.world.step().joints.max_error, 1e-12);
  EXPECT_NEAR(bar.angle().position, 0.5, 1e-12);
  EXPECT_EQ(bar.world.report().joints.dependent_rows, 6u);
}

TEST(Laws, OfAResetAreThoseOfTheStart) {
  CoordinateLaw law = driven(2.0);
  Bar bar(Method::kRungeKutta, 0.01, law);
  bar.run(0.3);
  bar.world.set_motor(bar.hinge, 0, std::nullopt);
  bar.run(0.3);
  bar.world.reset();
  EXPECT_NEAR(bar.angle().position, 0.0, 1e-15);
  bar.run(0.3);
  EXPECT_NEAR(bar.angle().position, 0.6, 1e-13);
}

// A spring removed in mid-swing leaves the speed; a spring added starts at the present coordinate.
TEST(Laws, AreReplacedWhileRunning) {
  for (const Method method : kSmoothMethods) {
    CoordinateLaw law;
    law.stiffness = 30.0;
    law.rest = 0.7;
    Bar bar(method, 0.002, law);
    bar.run(0.3);
    const double speed = bar.angle().velocity, position = bar.angle().position;
    bar.world.set_law(bar.hinge, 0, CoordinateLaw{});
    bar.run(0.2);
    // energy_momentum continues with velocities at the end of a step, which are of order 4
    const double tolerance = method == Method::kRungeKutta ? 1e-9 : 1e-6;
    EXPECT_NEAR(bar.angle().velocity, speed, tolerance) << name(method);
    EXPECT_NEAR(bar.angle().position, position + 0.2 * speed, tolerance) << name(method);
    law.position = 1.0;  // the coordinate has this value from here on
    law.rest = 1.0;
    bar.world.set_law(bar.hinge, 0, law);
    const double omega = std::sqrt(30.0 / kBarInertia);
    bar.run(0.2);
    EXPECT_NEAR(bar.angle().position, 1.0 + speed / omega * std::sin(omega * 0.2), 1e-6)
        << name(method);
    EXPECT_THROW(bar.world.set_law(bar.hinge, 1, law), std::invalid_argument);
  }
}

TEST(Laws, ThatCannotBeAreRefusedByField) {
  const auto refused = [](const std::function<void(CoordinateLaw*)>& set,
                          const std::string& field) {
    CoordinateLaw law;
    set(&law);
    try {
      Bar bar(Method::kAuto, 0.01, law);
    } catch (const std::invalid_argument& error) {
      EXPECT_EQ(std::string(error.what()).rfind(field + ":", 0), 0u) << error.what();
      return;
    }
    ADD_FAILURE() << field << " was taken";
  };
  refused([](CoordinateLaw* law) { law->stiffness = -1.0; }, "stiffness");
  refused([](CoordinateLaw* law) { law->friction = kNaN; }, "friction");
  refused([](CoordinateLaw* law) { law->lower = kNaN; }, "lower");
  refused([](CoordinateLaw* law) { law->lower = law->upper = 1.0; }, "upper");
  refused([](CoordinateLaw* law) { law->damping_ratio = 0.1; }, "damping_ratio");
  refused([](CoordinateLaw* law) { law->frequency = law->stiffness = 1.0; }, "frequency");
  refused([](CoordinateLaw* law) { law->limit_restitution = 1.5; }, "limit_restitution");
  refused([](CoordinateLaw* law) { law->motor.emplace().servo_frequency = 1.0; },
          "motor.servo_frequency");
  refused(
      [](CoordinateLaw* law) {
        law->motor.emplace().force = 1.0;
        law->motor->bias = 1.0;
      },
      "motor.force");
}

TEST(Motors, OnceTakenAwayNoBiasIsTold) {
  for (const Method method : kSmoothMethods) {
    CoordinateLaw law;
    law.motor.emplace().bias = 0.5;
    Bar bar(method, 0.01, law);
    bar.world.step();
    EXPECT_EQ(bar.world.joint_state(bar.hinge).bias, 0.5);
    bar.world.set_motor(bar.hinge, 0, std::nullopt);
    bar.world.step();
    EXPECT_EQ(bar.world.joint_state(bar.hinge).bias, 0.0) << name(method);
  }
}

}  // namespace
}  // namespace constraint_sim::engine
