// Steps of contacts that are divided to keep their estimated error within contact_tolerance.

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <string>
#include <vector>

#include "constraint_sim/engine/snapshot.h"
#include "constraint_sim/engine/world.h"
#include "contact_errors.h"
#include "support.h"

namespace constraint_sim::engine {
namespace {

using Eigen::Vector3d;

WorldOptions controlled(double time_step, double contact_tolerance) {
  WorldOptions options;
  options.method = Method::kTimeStepping;
  options.time_step = time_step;
  options.contact_tolerance = contact_tolerance;
  options.sleep_after = kInfinity;
  return options;
}

Body ball(double height, const Vector3d& velocity) {
  Body body = make_body("ball", Sphere{0.1}, 1.0, {0.0, 0.0, height});
  body.friction = 0.5;
  body.state.linear_velocity = velocity;
  return body;
}

/// A kinematic deck whose top is at 0.
Body rising_deck(double speed) {
  Body deck = make_body("deck", Box{{4.0, 4.0, 0.1}}, 0.0, {0.0, 0.0, -0.05});
  deck.type = BodyType::kKinematic;
  deck.state.linear_velocity = {0.0, 0.0, speed};
  return deck;
}

Body tilted_box() {
  Body body = make_body("box", Box{{0.3, 0.2, 0.1}}, 1.0, {0.0, 0.0, 0.4});
  body.friction = 0.5;
  body.state.orientation = Eigen::Quaterniond(0.1, 0.9, 0.2, 0.3).normalized();
  return body;
}

World on_floor(const WorldOptions& options, const std::vector<Body>& bodies) {
  World world(options);
  world.add_body(make_floor(0.5));
  for (const Body& body : bodies) world.add_body(body);
  return world;
}

double deepest_contact(const World& world) {
  double deepest = 0.0;
  for (const Contact& contact : world.contacts()) deepest = std::max(deepest, contact.depth);
  return deepest;
}

/// Steps until `time` and returns the sum of the error estimates.
double run(World* world, double time) {
  double sum = 0.0;
  while (world->time() < time - 1e-9) sum += world->step().local_error;
  return sum;
}

// A ball that falls at a slant hits the floor, rolls at once, and has 5/7 of its speed then. The
// tolerance of the test is ten times kLocatedGap of the thinner shape, up to which hits are
// located.
TEST(ContactControl, ABallThatLandsRollsAsTheClosedFormSays) {
  for (const double time_step : {1.0 / 30.0, 0.01, 1.0 / 240.0, 1e-3}) {
    World world = on_floor(controlled(time_step, 1e-4), {ball(0.5, {1.0, 0.0, 0.0})});
    run(&world, 1.0);
    const BodyState& state = world.state(world.find_body("ball"));
    const double fall = std::sqrt(2.0 * 0.4 / kGravity);
    EXPECT_NEAR(state.position.x(), fall + 5.0 / 7.0 * (world.time() - fall), 1e-8) << time_step;
    EXPECT_NEAR(state.position.z(), 0.1, 1e-8) << time_step;
    EXPECT_NEAR(state.linear_velocity.x(), 5.0 / 7.0, 1e-9) << time_step;
  }
}

// At 2 m/s, or a sixth of its thickness a step, a ball lands with an overlap otherwise.
TEST(ContactControl, AFastBodyLandsWithoutAnOverlap) {
  const auto deepest_of = [](double tolerance) {
    double deepest = 0.0;
    for (const double height : {0.3, 0.31, 0.32, 0.33}) {
      World world = on_floor(controlled(1.0 / 60.0, tolerance), {ball(height, Vector3d::Zero())});
      while (world.time() < 0.5) {
        world.step();
        deepest = std::max(deepest, deepest_contact(world));
      }
    }
    return deepest;
  };
  EXPECT_LT(deepest_of(1e-4), 1e-8);
  EXPECT_GT(deepest_of(0.0), 1e-4);
}

// A box that slides stops after v²/(2 μ g).
TEST(ContactControl, ASlidingBoxStopsWithinTheTolerance) {
  const Vector3d velocity(2.0, 0.5, 0.0);
  for (const double tolerance : {1e-3, 1e-4, 1e-5}) {
    Body box = make_body("box", Box{{0.3, 0.2, 0.1}}, 1.0, {0.0, 0.0, 0.05});
    box.friction = 0.5;
    box.state.linear_velocity = velocity;
    World world = on_floor(controlled(1.0 / 240.0, tolerance), {box});
    const double estimate = run(&world, 1.0);
    const double duration = velocity.norm() / (2.0 * 0.5 * kGravity);
    const Vector3d off = world.state(world.find_body("box")).position - duration * velocity -
                         Vector3d(0.0, 0.0, 0.05);
    EXPECT_LT(off.norm(), tolerance) << tolerance;
    EXPECT_LT(off.norm(), 4.0 * estimate) << tolerance;
  }
}

// Against events, which find every hit and every end of a slip: the corners of a box land one after
// the other. A hundredth of the tolerance has a tenth of the error, since the error of an impact
// falls by its location, not by the tolerance.
TEST(ContactControl, TheErrorOfATumblingBoxFollowsTheTolerance) {
  WorldOptions by_events = controlled(1.0 / 240.0, 0.0);
  by_events.method = Method::kEventDriven;
  World exact = on_floor(by_events, {tilted_box()});
  run(&exact, 0.3);
  const auto error_at = [&](double tolerance) {
    World world = on_floor(controlled(1.0 / 240.0, tolerance), {tilted_box()});
    const double estimate = run(&world, 0.3);
    const double error = problems::largest_difference(world, exact);
    EXPECT_LT(error, 0.3 * tolerance) << tolerance;
    EXPECT_LT(error, 4.0 * estimate) << tolerance;
    EXPECT_LT(estimate, 0.4 * tolerance) << tolerance;  // 0.35 where parts are the shortest
    return error;
  };
  const double loose = error_at(1e-3);
  error_at(1e-4);
  EXPECT_LT(error_at(1e-5), 0.2 * loose);
}

TEST(ContactControl, EstimatesAreRarelyBelowAQuarterOfTheError) {
  contact_errors::Table table;
  for (const unsigned seed : {0u, 1u, 3u, 5u, 6u, 8u})
    for (const random_events::Kind kind :
         {random_events::Kind::kTouching, random_events::Kind::kTouchingWithPoses})
      contact_errors::compare({1, seed, 1e-4, 8}, static_cast<unsigned>(kind), seed, &table);
  ASSERT_GT(table.ratios.size(), 100u);
  const auto low = std::count_if(table.ratios.begin(), table.ratios.end(), [](const auto& one) {
    return one.ratio < contact_errors::kTooLow;
  });
  EXPECT_LE(low, 0.05 * static_cast<double>(table.ratios.size()));
}

// A tower at rest is taken in one part a step, since nothing moves.
TEST(ContactControl, WhatRestsIsSolvedOnceAStep) {
  World world(controlled(1.0 / 60.0, 1e-4));
  world.add_body(make_floor(0.6));
  for (int i = 0; i < 10; ++i) {
    Body cube = make_body("cube_" + std::to_string(i), Box{{0.2, 0.2, 0.2}}, 1.0,
                          {0.0, 0.0, 0.1 + 0.2 * i});
    cube.friction = 0.6;
    world.add_body(cube);
  }
  run(&world, 0.5);
  for (int k = 0; k < 30; ++k) {
    const StepReport& report = world.step();
    EXPECT_EQ(report.costs.substeps, 1u);
    EXPECT_EQ(report.costs.rejected, 0u);
    EXPECT_LT(report.local_error, 1e-8);
  }
  EXPECT_NEAR(world.state(world.find_body("cube_9")).position.z(), 1.9, 1e-8);
}

TEST(ContactControl, WithoutAToleranceAStepIsOnePart) {
  World world = on_floor(controlled(0.01, 0.0), {ball(0.1, {1.0, 0.0, 0.0})});
  const StepReport& report = world.step();
  EXPECT_GT(report.local_error, 0.0);
  EXPECT_EQ(report.costs.substeps, 0u);
  EXPECT_EQ(report.contacts.hits, 0u);
}

// A deck that rises at a constant speed takes a ball along from the instant at which it reaches it.
TEST(ContactControl, ABodyIsHitByAKinematicDeck) {
  World world(controlled(1.0 / 60.0, 1e-4));
  world.add_body(rising_deck(0.5));
  world.add_body(ball(0.3, Vector3d::Zero()));
  run(&world, 1.0);
  EXPECT_NEAR(world.state(world.find_body("ball")).position.z(), 0.1 + 0.5 * world.time(), 1e-8);
}

// Two groups apart have estimates of their own.
TEST(ContactControl, GroupsDoNotShareAnEstimate) {
  Body box = make_body("box", Box{{0.2, 0.2, 0.2}}, 1.0, {5.0, 0.0, 0.1});
  box.friction = 0.5;
  World world = on_floor(controlled(1.0 / 60.0, 1e-4), {ball(0.1, {1.0, 0.0, 0.0}), box});
  run(&world, 0.2);
  const std::vector<Island> islands = world.islands();
  ASSERT_EQ(islands.size(), 2u);
  EXPECT_LT(islands[1].local_error, 1e-9);
  EXPECT_EQ(world.report().local_error, std::max(islands[0].local_error, islands[1].local_error));
}

TEST(ContactControl, CopiesSnapshotsAndThreadsGoOnWithTheSameBits) {
  const auto scene = [](int threads) {
    WorldOptions options = controlled(1.0 / 60.0, 1e-4);
    options.threads = threads;
    Body fast = ball(1.0, {0.3, 0.1, -3.0});
    fast.name = "fast";
    return on_floor(options, {tilted_box(), ball(0.7, {-0.1, 0.0, 0.0}), fast});
  };
  World world = scene(1), threaded = scene(2);
  run(&world, 0.25);
  run(&threaded, 0.25);
  World copy = world, read = read_snapshot(write_snapshot(world));
  for (World* other : {&world, &copy, &read, &threaded}) run(other, 0.5);
  for (const World* other : {&copy, &read}) EXPECT_EQ(other->state_hash(), world.state_hash());
  for (const BodyId id : world.body_ids())
    EXPECT_EQ(threaded.state(id).position, world.state(id).position);
}

WorldOptions weightless_and_controlled(double time_step, double contact_tolerance) {
  WorldOptions options = controlled(time_step, contact_tolerance);
  options.gravity.setZero();
  return options;
}

// Without gravity a ball flies straight, so the time of its impact is known, also where the impact
// is within the last share of the step that is not divided.
TEST(ContactControl, AnImpactAtAnyTimeOfTheStepIsLocated) {
  constexpr double kStep = 1.0 / 60.0;
  for (const double speed : {0.5, 3.0, 30.0})
    for (const double share : {0.001, 0.3, 0.99, 0.9985, 0.9999}) {
      World world = on_floor(weightless_and_controlled(kStep, 1e-5),
                             {ball(0.1 + share * kStep * speed, {0.0, 0.0, -speed})});
      world.step();
      EXPECT_EQ(world.report().contacts.hits, 1u) << speed << ' ' << share;
      EXPECT_LT(world.report().local_error, 1e-5 * kStep) << speed << ' ' << share;
      EXPECT_NEAR(world.state(world.find_body("ball")).position.z(), 0.1, 1e-8)
          << speed << ' ' << share;
    }
}

TEST(ContactControl, AnImpactOnAMovingDeckIsLocated) {
  constexpr double kStep = 1.0 / 240.0;
  for (const double gap : {1e-3, 2e-3, 3e-3}) {
    World world(controlled(kStep, 1e-4));
    world.add_body(rising_deck(0.5));
    world.add_body(ball(0.1 + gap, {0.0, 0.0, -1.0}));
    world.step();
    EXPECT_EQ(world.report().contacts.hits, 1u) << gap;
    EXPECT_LT(deepest_contact(world), 1e-8) << gap;
    EXPECT_LT(world.report().local_error, 1e-4 * kStep) << gap;
  }
}

// A tumbling box on a deck that is faster than it: the deck is where it is at the time of each
// part.
TEST(ContactControl, AFastDeckDoesNotPassIntoABox) {
  World world(controlled(1.0 / 60.0, 1e-5));
  world.add_body(rising_deck(10.0));
  world.add_body(tilted_box());
  for (int k = 0; k < 6; ++k) {
    world.step();
    EXPECT_LT(deepest_contact(world), 1e-4) << k;
  }
}

// Three hits of a column in a step: what contacts report is the change of momentum.
TEST(ContactControl, ReportedForcesAreTheChangeOfMomentum) {
  constexpr double kStep = 1.0 / 60.0;
  Body low = ball(0.11, {0.0, 0.0, -3.0}), high = ball(0.33, {0.0, 0.0, -3.0});
  high.name = "high";
  low.restitution = high.restitution = 1.0;
  World world = on_floor(weightless_and_controlled(kStep, 1e-4), {low, high});
  world.step();
  EXPECT_GE(world.report().contacts.hits, 3u);
  double by_floor = 0.0, between = 0.0;
  for (const Contact& contact : world.contacts())
    (contact.body_a == world.find_body("floor") ? by_floor : between) +=
        contact.normal_force * kStep;
  const double low_after = world.state(world.find_body("ball")).linear_velocity.z();
  const double high_after = world.state(world.find_body("high")).linear_velocity.z();
  EXPECT_NEAR(by_floor, low_after + high_after + 6.0, 1e-9);
  EXPECT_NEAR(between, high_after + 3.0, 1e-9);
}

TEST(ContactControl, AGapThatStaysOpenIsNoContact) {
  World world = on_floor(controlled(1.0 / 240.0, 1e-4), {ball(0.103, {1.5, 0.0, 0.0})});
  world.step();
  EXPECT_TRUE(world.contacts().empty());
}

// Many touching balls are taken in two halves; a ball that is hit within the step is seen by a thin
// wall beside it.
TEST(ContactControl, ABodyThatIsHitDoesNotPassAThinWall) {
  for (const int count : {10, 40}) {
    World world(controlled(1.0 / 60.0, 1e-4));
    world.add_body(make_floor(0.3));
    for (int i = 0; i < count; ++i) {
      Body one = make_body("ball_" + std::to_string(i), Sphere{0.1}, 1.0, {-0.2 * i, 0.0, 0.1});
      one.friction = 0.3;
      world.add_body(one);
    }
    Body wall = make_body("wall", Box{{0.02, 1.0, 1.0}}, 0.0, {0.18, 0.0, 0.5});
    wall.type = BodyType::kStatic;
    world.add_body(wall);
    world.add_body(make_body("bullet", Sphere{0.05}, 1.0, {0.0, -0.3, 0.1}));
    BodyState shot = world.state(world.find_body("bullet"));
    shot.position = {-0.1, -0.25, 0.1};
    shot.linear_velocity = {15.0, 26.0, 0.0};
    world.set_state(world.find_body("bullet"), shot);
    for (int k = 0; k < 12; ++k) {
      world.step();
      const bool is_named = world.report().contacts.hits_left_body.has_value();
      EXPECT_TRUE(world.state(world.find_body("ball_0")).position.x() < 0.18 || is_named) << count;
    }
  }
}

// Corners of a body that only turns reach farther than its centre moves.
TEST(ContactControl, ABodyThatTurnsDoesNotSinkIn) {
  Body cube = make_body("cube", Box{{0.2, 0.2, 0.2}}, 1.0, {0.0, 0.0, 0.1005});
  cube.state.angular_velocity = {0.0, 1.9, 0.0};
  World world(weightless_and_controlled(1.0 / 60.0, 1e-4));
  Body slab = make_body("slab", Box{{1.0, 1.0, 0.2}}, 0.0, {0.0, 0.0, -0.1});
  slab.type = BodyType::kStatic;
  world.add_body(slab);
  world.add_body(cube);
  for (int k = 0; k < 6; ++k) {
    world.step();
    EXPECT_LT(deepest_contact(world), 1e-6) << k;
  }
}

}  // namespace
}  // namespace constraint_sim::engine
