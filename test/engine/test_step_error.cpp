// Error estimates of steps of impulses that are taken in one part. Closed forms give the error of a
// step from its start; the ratio of estimate and error is a closed form too where one thing
// happens.

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <string>
#include <utility>

#include "constraint_sim/engine/snapshot.h"
#include "constraint_sim/engine/world.h"
#include "contact_errors.h"
#include "support.h"

namespace constraint_sim::engine {
namespace {

using Eigen::Vector3d;

constexpr double kStep = 0.01, kFriction = 0.5;

WorldOptions taken_once(Method method = Method::kTimeStepping) {
  WorldOptions options;
  options.method = method;
  options.time_step = kStep;
  options.sleep_after = kInfinity;
  return options;
}

Body box_on_floor(double speed, double friction) {
  Body box = make_body("box", Box{{0.3, 0.2, 0.1}}, 2.0, {0.0, 0.0, 0.05});
  box.friction = friction;
  box.state.linear_velocity = {speed, 0.0, 0.0};
  return box;
}

World on_floor(const WorldOptions& options, const Body& body) {
  World world(options);
  world.add_body(make_floor(body.friction));
  world.add_body(body);
  return world;
}

// A box slides for three and a half steps of constant deceleration a, which the mean velocity
// follows exactly, then stops within a step: the displacement is ½ a (h/2)², and the mean velocity
// makes ¼ a h² of it. The estimate is half the change of the impulses over the step, ¼ a h².
// Iterations leave residuals of 1e-3 a h, which is a share of 2e-3 of the last change.
TEST(StepError, ABoxThatStopsHasTwiceItsError) {
  const double a = kFriction * kGravity;
  World world = on_floor(taken_once(), box_on_floor(3.5 * a * kStep, kFriction));
  const auto x = [&] { return world.state(world.find_body("box")).position.x(); };
  world.step();  // begins without impulses of a step before
  for (int k = 1; k < 3; ++k) EXPECT_LT(world.step().local_error, 2e-3 * a * kStep * kStep) << k;
  const double before = x();
  const double estimate = world.step().local_error;
  const double error = std::abs(x() - before - 0.125 * a * kStep * kStep);
  EXPECT_NEAR(error, 0.125 * a * kStep * kStep, 1e-2 * error);
  EXPECT_NEAR(estimate, 0.25 * a * kStep * kStep, 1e-2 * estimate);
}

// Without gravity a ball flies straight, and moves by e v for the rest of the step after its hit.
// An estimate is at least a quarter of the error, and at most twice the displacement by the change
// (1 + e) v in a step. At 0.8 m/s the contact has a gap before the hit, at 2 m/s the gap is too
// wide for one, and at 30 m/s hits are located.
TEST(StepError, ABallThatLandsHasAnEstimateOfItsError) {
  for (const double speed : {0.8, 2.0, 30.0})
    for (const double restitution : {0.0, 0.5, 1.0})
      for (const double share : {0.05, 0.3, 0.7, 0.95}) {
        WorldOptions options = taken_once();
        options.gravity.setZero();
        Body ball = make_body("ball", Sphere{0.1}, 1.0, {0.0, 0.0, 0.1 + share * kStep * speed});
        ball.restitution = restitution;
        ball.state.linear_velocity = {0.0, 0.0, -speed};
        World world = on_floor(options, ball);
        const double estimate = world.step().local_error;
        const double left = (1.0 - share) * kStep * speed;
        const double error =
            std::abs(world.state(world.find_body("ball")).position.z() - 0.1 - restitution * left);
        EXPECT_GE(estimate, 0.25 * error - 1e-8) << speed << ' ' << restitution << ' ' << share;
        EXPECT_LE(estimate, 2.0 * (1.0 + restitution) * kStep * speed)
            << speed << ' ' << restitution << ' ' << share;
      }
}

// A force that acts for half a step moves a body by ⅜ a h², and the mean velocity by ¼ a h².
TEST(StepError, AForceForHalfAStepHasTwiceItsError) {
  constexpr double kForce = 3.0;
  World world = on_floor(taken_once(), box_on_floor(0.0, 0.0));
  world.step();
  const BodyId box = world.find_body("box");
  Wrench wrench;
  wrench.body = box;
  wrench.force = {kForce, 0.0, 0.0};
  wrench.start = world.time();
  wrench.end = world.time() + 0.5 * kStep;
  world.add_wrench(wrench);
  const double before = world.state(box).position.x();
  const double estimate = world.step().local_error;
  const double a = kForce / world.body(box).mass;
  const double error = std::abs(world.state(box).position.x() - before - 0.375 * a * kStep * kStep);
  EXPECT_NEAR(error, 0.125 * a * kStep * kStep, 1e-9);
  EXPECT_NEAR(estimate, 2.0 * error, 1e-9);
}

// Nothing moves from the first step on, with and without impulses of a step before: the bound of
// bodies that hardly move is twice the displacement by rounding.
TEST(StepError, ABoxAtRestHasNone) {
  for (const bool warm_starting : {true, false}) {
    WorldOptions options = taken_once();
    options.warm_starting = warm_starting;
    World world = on_floor(options, box_on_floor(0.0, kFriction));
    for (int k = 0; k < 5; ++k) EXPECT_LT(world.step().local_error, 1e-9) << warm_starting;
  }
}

// sequential_impulses moves bodies by the last velocity, ½ g h² too far in each step of a fall. The
// overlap of the balls is below the one that sweeps correct, so they do not push each other.
TEST(StepError, SweptBodiesInFallHaveTheErrorOfTheirPosition) {
  World world(taken_once(Method::kSequentialImpulses));
  world.add_body(make_body("left", Sphere{0.1}, 1.0, {0.0, 0.0, 5.0}));
  world.add_body(make_body("right", Sphere{0.1}, 1.0, {0.2 - 1e-4, 0.0, 5.0}));
  for (int k = 1; k <= 3; ++k) {
    const BodyState before = world.state(world.find_body("left"));
    const double estimate = world.step().local_error;
    ASSERT_EQ(world.islands().front().method, Method::kSequentialImpulses);
    const double fall = -before.linear_velocity.z() * kStep + 0.5 * kGravity * kStep * kStep;
    const double error =
        before.position.z() - fall - world.state(world.find_body("left")).position.z();
    EXPECT_NEAR(error, 0.5 * kGravity * kStep * kStep, 1e-12) << k;
    EXPECT_NEAR(estimate, error, 1e-12) << k;
  }
}

contact_errors::Table compared(Method method, unsigned count) {
  contact_errors::Table table;
  for (unsigned seed = 0; seed < count; ++seed)
    for (const random_events::Kind kind :
         {random_events::Kind::kTouching, random_events::Kind::kTouchingWithLaws,
          random_events::Kind::kTouchingWithPoses})
      contact_errors::compare({1, seed, 0.0, 8, method}, static_cast<unsigned>(kind), seed, &table);
  std::sort(table.ratios.begin(), table.ratios.end(),
            [](const auto& l, const auto& r) { return l.ratio < r.ratio; });
  return table;
}

// Against the same step by events, or in parts of 1e-5 m/s: with friction, restitution, joints and
// laws, at time steps of 1/10 to 1/1000 s (docs/methods/contact_error.md).
TEST(StepError, EstimatesAreRarelyBelowAQuarterOfTheError) {
  for (const auto& [method, scenes] :
       {std::pair(Method::kTimeStepping, 5u), std::pair(Method::kSequentialImpulses, 2u)}) {
    const contact_errors::Table table = compared(method, scenes);
    ASSERT_GT(table.ratios.size(), 300u) << name(method);
    const auto low = std::count_if(table.ratios.begin(), table.ratios.end(), [](const auto& one) {
      return one.ratio < contact_errors::kTooLow;
    });
    EXPECT_LE(low, 0.01 * static_cast<double>(table.ratios.size())) << name(method);
    EXPECT_LT(table.ratios[table.ratios.size() / 2].ratio, 4.0) << name(method);
  }
}

World tower(const WorldOptions& options) {
  World world(options);
  world.add_body(make_floor(0.6));
  for (int i = 0; i < 10; ++i) {
    Body cube = make_body("cube_" + std::to_string(i), Box{{0.2, 0.2, 0.2}}, 1.0,
                          {0.0, 0.0, 0.1 + 0.2 * i});
    cube.friction = 0.6;
    world.add_body(cube);
  }
  return world;
}

// One sweep over a tower leaves rates between its cubes. Many sweeps leave none.
TEST(StepError, SweepsThatLeaveAResidualHaveNoEstimate) {
  WorldOptions options = taken_once(Method::kSequentialImpulses);
  for (const int sweeps : {1, 10000}) {
    options.iterations = sweeps;
    World world = tower(options);
    world.step();  // the cubes sink into each other
    const StepReport& report = world.step();
    EXPECT_EQ(std::isnan(report.local_error), sweeps == 1) << report.contacts.solver_residual;
  }
}

// Rows of more than 500 bodies in contact are swept; other islands keep their estimate.
TEST(StepError, SweptGroupsHaveNoEstimate) {
  World world(taken_once());
  world.add_body(make_floor(kFriction));
  for (int i = 0; i < 501; ++i)
    world.add_body(make_body("ball_" + std::to_string(i), Sphere{0.1}, 1.0, {0.2 * i, 0.0, 0.1}));
  EXPECT_TRUE(std::isnan(world.step().local_error));
}

// No memory is needed from one step to the next but the impulses, which warm starts have.
TEST(StepError, CopiesAndSnapshotsGoOnWithTheSameEstimates) {
  Body box = box_on_floor(1.0, kFriction);
  box.state.angular_velocity = {0.0, 0.0, 3.0};
  World world = on_floor(taken_once(), box);
  for (int k = 0; k < 5; ++k) world.step();
  World copy = world, read = read_snapshot(write_snapshot(world));
  for (int k = 0; k < 30; ++k) {
    const double estimate = world.step().local_error;
    EXPECT_EQ(copy.step().local_error, estimate) << k;
    EXPECT_EQ(read.step().local_error, estimate) << k;
  }
}

}  // namespace
}  // namespace constraint_sim::engine
