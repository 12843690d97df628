// verify(): distinguishes chaos from faults, and tests the estimate as a bound of the final error.

#include <atomic>
#include <cmath>

#include "constraint_sim/engine/scene.h"
#include "constraint_sim/engine/verify.h"
#include "pendulum.h"
#include "support.h"

namespace constraint_sim::engine {
namespace {

VerifyOptions verify_ticks(std::uint64_t ticks) {
  VerifyOptions options;
  options.ticks = ticks;
  return options;
}

World swinging_pendulum(double time_step, double from, double length) {
  WorldOptions options;
  options.time_step = time_step;
  World world(options);
  const BodyId bob = world.add_body(make_body(
      "bob", Point{}, 1.0, length * Eigen::Vector3d(std::sin(from), 0.0, -std::cos(from))));
  world.add_joint(hang("rod", bob, rod(length)));
  return world;
}

const VerifiedBody& only_body(const VerifyReport& report) { return report.bodies.at(0); }

TEST(Verify, BoundsTheErrorOfAPendulumByEstimateAndGrowth) {
  const double length = 0.7, from = 2.0;
  for (const double tolerance : {1e-4, 1e-6, 1e-8}) {
    World world = swinging_pendulum(0.05, from, length);
    WorldOptions options = world.options();
    options.tolerance = tolerance;
    world.set_options(options);
    const VerifyReport report = verify(world, verify_ticks(100));
    EXPECT_FALSE(report.exceeds()) << to_table(report);
    EXPECT_EQ(report.other_method, Method::kEnergyMomentum);
    const VerifiedFigures& figures = only_body(report).figures;
    EXPECT_NEAR(figures.time, 5.0, 1e-12);
    // order 4, at half the step of the compared run
    EXPECT_LE(figures.other_method, figures.other_error) << only_body(report).no_other_method;

    for (int i = 0; i < 100; ++i) world.step();
    // θ(t) = 2 asin(k sn(K + ω t, k)), as in pendulum.h
    const long double k = std::sin(static_cast<long double>(from) / 2);
    const long double u =
        std::comp_ellint_1(k) + std::sqrt(static_cast<long double>(kGravity / length)) * 5.0L;
    const auto exact = static_cast<double>(2 * std::asin(k * elliptic_sine(u, k)));
    const Eigen::Vector3d place = length * Eigen::Vector3d(std::sin(exact), 0.0, -std::cos(exact));
    const double error = (world.state(world.find_body("bob")).position - place).norm();
    // 1e-13: rounding of the closed form and of 100 ticks
    EXPECT_LE(error, figures.global_error() + 1e-13) << tolerance;
    EXPECT_GE(figures.growth, 1.0);
  }
}

/// A box that spins about its anchor in the world so fast that energy_momentum splits a step of
/// 0.01 s, though not its half.
World spinning_box() {
  WorldOptions options;
  options.time_step = 0.01;
  options.tolerance = 1e-7;
  World world(options);
  Body box = make_body("box", Box{{0.5, 0.4, 0.3}}, 1.5, {0.2, 0.1, 0.0});
  box.state.angular_velocity = {3.5, 14.0, 17.5};
  box.state.linear_velocity = box.state.angular_velocity.cross(box.state.position);
  const BodyId id = world.add_body(box);
  world.add_joint(
      make_joint("ball", kWorldBody, {0, 0, 0}, id, -box.state.position, JointKind::kBall));
  return world;
}

// Runs of energy_momentum at h and h/2 with one tolerance may have the same substeps. The runs that
// are compared differ by more than the error of the finer one, which is that to runge_kutta.
TEST(Verify, KnowsTheErrorOfAMethodThatSplitsItsSteps) {
  const World world = spinning_box();
  const auto final_place = [&](double time_step) {
    World run = world;
    WorldOptions options = run.options();
    options.method = Method::kEnergyMomentum;
    options.time_step = time_step;
    run.set_options(options);
    while (run.time() < 0.5 - 1e-9) run.step();
    return run.state(run.find_body("box")).position;
  };
  const double apart = (final_place(0.01) - final_place(0.005)).norm();
  const VerifyReport report = verify(world, verify_ticks(50));
  EXPECT_FALSE(report.exceeds()) << to_table(report);
  const VerifiedFigures& figures = only_body(report).figures;
  EXPECT_LT(apart, 1e-12);  // equal substeps
  EXPECT_GT(figures.other_error, 1e-8);
  EXPECT_LE(figures.other_method, figures.other_error) << to_table(report);
}

// A twin 1e-10 away is metres away after some seconds, and so are the other runs: no fault.
TEST(Verify, TellsTheChaosOfADoublePendulumFromAFault) {
  WorldOptions options;
  options.time_step = 0.02;
  World world(options);
  const BodyId upper = world.add_body(make_body("upper", Point{}, 1.0, {0.1, 0.0, 1.0}));
  const BodyId lower = world.add_body(make_body("lower", Point{}, 1.0, {0.3, 0.0, 2.0}));
  world.add_joint(hang("first", upper));
  world.add_joint(make_joint("second", upper, {0, 0, 0}, lower, {0, 0, 0}));
  const VerifyReport report = verify(world, verify_ticks(1500));
  EXPECT_FALSE(report.exceeds()) << to_table(report);
  for (const VerifiedBody& body : report.bodies) {
    ASSERT_TRUE(body.chaotic_from) << to_table(report);
    EXPECT_STREQ(body.verdict(), "chaotic");
    EXPECT_GT(*body.chaotic_from, 2.0);
    EXPECT_GT(body.figures.growth, 1e7);
  }
}

TEST(Verify, FindsImpulsesWithALongTick) {
  World world = swinging_pendulum(0.1, 1.0, 1.0);
  WorldOptions options = world.options();
  options.method = Method::kSequentialImpulses;
  world.set_options(options);
  const VerifyReport report = verify(world, verify_ticks(10));
  EXPECT_TRUE(report.exceeds());
  const VerifiedBody& bob = only_body(report);
  EXPECT_STREQ(bob.verdict(), "exceeds");
  EXPECT_NE(bob.no_estimate.find("sequential_impulses has no estimate"), std::string::npos);
  EXPECT_EQ(report.other_method, Method::kAuto);
  // first order: off by g h² / 2 and more from the first tick on
  EXPECT_GT(bob.exceeded->half_step, 1e-3);
  EXPECT_GT(bob.exceeded->other_method, 1e-3);
}

// A tick without substeps to a tolerance, of a motion that the tick does not resolve.
TEST(Verify, FindsSubstepsWithoutATolerance) {
  World world = swinging_pendulum(0.7, 2.5, 0.3);
  WorldOptions options = world.options();
  options.method = Method::kRungeKutta;
  options.order = 5;
  options.tolerance = 0.0;
  world.set_options(options);
  const VerifyReport report = verify(world, verify_ticks(20));
  const VerifiedBody& bob = only_body(report);
  // either the estimate or the comparison shows it
  EXPECT_TRUE(report.exceeds() || bob.chaotic_from || bob.figures.global_error() > 1e-3)
      << to_table(report);
}

TEST(Verify, LeavesOutWhatNoSecondMethodAdvances) {
  WorldOptions options;
  World world(options);
  world.add_body(make_body("ball", Sphere{0.1}, 1.0, {0.0, 0.0, 0.3}));
  world.add_body(make_floor(0.3));
  const VerifyReport falls = verify(world, verify_ticks(5));
  EXPECT_EQ(only_body(falls).no_other_method,
            "a body without joints moves by the same formulas in every method");
  const VerifyReport lands = verify(world, verify_ticks(100));
  EXPECT_FALSE(lands.exceeds()) << to_table(lands);
  EXPECT_FALSE(only_body(lands).no_other_method.empty());
  EXPECT_TRUE(std::isnan(only_body(lands).figures.other_method));

  World roped(options);
  const BodyId bob = roped.add_body(make_body("bob", Point{}, 1.0, {0.5, 0.0, 0.0}));
  roped.add_joint(hang("rope", bob, rope(0.8)));
  const VerifyReport swings = verify(roped, verify_ticks(100));
  EXPECT_FALSE(swings.exceeds()) << to_table(swings);
  EXPECT_EQ(only_body(swings).no_other_method, "no second method advances what has limits");
}

TEST(Verify, LeavesTheWorldAndItsHash) {
  World world = swinging_pendulum(0.01, 1.0, 1.0);
  for (int i = 0; i < 10; ++i) world.step();
  const std::uint64_t hash = world.state_hash();
  const VerifyReport report = verify(world, verify_ticks(50));
  EXPECT_EQ(report.ticks, 50u);
  EXPECT_EQ(world.state_hash(), hash);
}

// The first run repeats the world itself, bit for bit.
TEST(Verify, GivesEveryRunTheCommandsAtTheirTime) {
  World world = swinging_pendulum(0.01, 1.0, 1.0);
  VerifyOptions options = verify_ticks(100);
  int calls = 0;
  options.before_tick = [&](World& now) {
    ++calls;
    if (std::abs(now.time() - 0.5) > 1e-9) return;
    BodyState state = now.state(now.find_body("bob"));
    state.linear_velocity.y() += 1.0;
    now.set_state(now.find_body("bob"), state);
  };
  const VerifyReport report = verify(world, options);
  EXPECT_EQ(calls, 500);
  EXPECT_FALSE(report.exceeds()) << to_table(report);
  EXPECT_GT(only_body(report).figures.growth, 1.0);
}

TEST(Verify, EndsWhereABodyIsRemoved) {
  World world = swinging_pendulum(0.01, 1.0, 1.0);
  VerifyOptions options = verify_ticks(10);
  options.before_tick = [](World& now) {
    if (now.time() > 0.035 && now.has_body("bob")) now.remove_body(now.find_body("bob"));
  };
  const VerifyReport report = verify(world, options);
  EXPECT_EQ(report.ticks, 4u);
  EXPECT_NE(report.failure.find("'bob' was removed"), std::string::npos) << report.failure;
}

TEST(Verify, EndsAtTheStopFlag) {
  World world = swinging_pendulum(0.01, 1.0, 1.0);
  std::atomic<bool> stop{false};
  VerifyOptions options = verify_ticks(1000000000);
  options.stop = &stop;
  options.progress = [&](std::uint64_t done) { stop = done == 7; };
  const VerifyReport report = verify(world, options);
  EXPECT_TRUE(report.stopped);
  EXPECT_EQ(report.ticks, 7u);
}

TEST(Verify, NamesTheRunThatFails) {
  World world = swinging_pendulum(0.01, 1.0, 1.0);
  world.add_body(make_body("rocket", Point{}, 1.0, {5.0, 0.0, 0.0}));
  BodyState state = world.state(world.find_body("rocket"));
  state.linear_velocity.x() = 0.99 * kMostMagnitude;
  world.set_state(world.find_body("rocket"), state);
  Wrench wrench;
  wrench.body = world.find_body("rocket");
  wrench.force.x() = kMostMagnitude;
  world.add_wrench(wrench);
  const VerifyReport report = verify(world, verify_ticks(1000));
  EXPECT_NE(report.failure.find("failed after"), std::string::npos) << report.failure;
}

TEST(Verify, RefusesOptionsThatCannotBe) {
  const World world = swinging_pendulum(0.01, 1.0, 1.0);
  VerifyOptions options;
  options.perturbation = 0.0;
  EXPECT_NE(refusal([&] { verify(world, options); }).find("perturbation"), std::string::npos);
  options = {};
  options.least = -1.0;
  EXPECT_NE(refusal([&] { verify(world, options); }).find("least"), std::string::npos);
  options = {};
  options.margin = 0.5;
  EXPECT_NE(refusal([&] { verify(world, options); }).find("margin"), std::string::npos);
}

TEST(Verify, TableHasALineForEachBody) {
  const VerifyReport report = verify(swinging_pendulum(0.01, 1.0, 1.0), verify_ticks(10));
  const std::string table = to_table(report);
  EXPECT_NE(table.find("bob"), std::string::npos);
  EXPECT_NE(table.find("energy_momentum [m]"), std::string::npos);
  EXPECT_NE(table.find("holds"), std::string::npos);
}

}  // namespace
}  // namespace constraint_sim::engine
