// Contacts that switch from events to impulses and back. Oracles: closed forms of lifting work;
// energy less the reported work, which nothing can raise; counts of switches; the same bits of a
// copy and of a snapshot.

#include <array>
#include <set>

#include "by_events.h"
#include "constraint_sim/engine/snapshot.h"
#include "support.h"

namespace constraint_sim::engine {
namespace {

using Eigen::Vector3d;

WorldOptions by_auto(double time_step) {
  WorldOptions options = engine::options(time_step);
  options.method = Method::kAuto;
  options.sleep_after = INFINITY;
  return options;
}

Body box_at(const std::string& name, const Vector3d& position, double mass = 1.0) {
  return with_surface(make_body(name, Box{{0.4, 0.4, 0.4}}, mass, position), 0.5, 0.0);
}

bool is_by_events(const World& world) {
  const std::vector<Island> islands = world.islands();
  return std::all_of(islands.begin(), islands.end(),
                     [](const Island& island) { return island.why == MethodReason::kFewContacts; });
}

// A fast body far away is in no group, and changes nothing.
TEST(ContactHandover, WhatIsFastFarAwayChangesNothing) {
  for (const double speed : {0.0, 50.0}) {
    World world(by_auto(0.01));
    world.add_body(with_surface(make_floor(0.0), 0.5, 0.0));
    std::vector<BodyId> boxes;
    for (int i = 0; i < 8; ++i)
      boxes.push_back(world.add_body(
          box_at("box" + std::to_string(i), {3.0 * (i % 2), 0.5 * std::floor(0.5 * i), 0.2})));
    Body bird = make_body("bird", Sphere{0.1}, 1.0, {100.0, 0.0, 50.0});
    bird.state.linear_velocity.y() = speed;
    world.add_body(bird);
    for (int i = 0; i < 20; ++i) {
      EXPECT_FALSE(world.step().outcome.failed);
      EXPECT_FALSE(is_by_impulses(world)) << speed << ", " << world.time();
    }
    for (const BodyId box : boxes) EXPECT_EQ(world.state(box).position.z(), 0.2) << speed;
  }
}

// A body far from all but one of a row pushes that one against its neighbour, and so on: all bodies
// that may be hit within the step are one group.
TEST(ContactHandover, GroupsReachAsFarAsTheirFastestDrives) {
  World world(by_auto(0.01));
  WorldOptions options = world.options();
  options.gravity.setZero();
  world.set_options(options);
  for (int i = 0; i < 4; ++i) {
    Body ball = with_surface(
        make_body("ball" + std::to_string(i), Sphere{0.1}, 1.0, {0.35 * i, 0.0, 0.0}), 0.1, 1.0);
    if (i == 0) ball.state.linear_velocity.x() = 50.0;
    world.add_body(ball);
  }
  world.step();
  EXPECT_FALSE(is_by_impulses(world));
  // 0.15 m between neighbours: 0.45 m of the path at 50 m/s
  EXPECT_NEAR(world.state(world.find_body("ball3")).position.x(), 3 * 0.35 + 50.0 * 0.01 - 0.45,
              1e-12);
}

// Bodies added in a small overlap are lifted in the first step, at a reported work of m g d.
TEST(ContactHandover, WhatIsPutDownTooDeepIsLiftedAndBooked) {
  for (const double depth : {1e-6, 1e-5, 1e-4, 1e-3}) {
    World world(by_auto(0.01));
    world.add_body(with_surface(make_floor(0.0), 0.5, 0.0));
    const BodyId below = world.add_body(box_at("below", {0.0, 0.0, 0.2 - depth}, 2.0));
    const BodyId above = world.add_body(box_at("above", {0.02, 0.01, 0.6 - 3.0 * depth}, 1.0));
    // every second scene has shape poses
    frame_anew(&world, {0.01, Method::kAuto, 1e-8, depth == 1e-5 || depth == 1e-3});
    const double before = world.energy();
    const StepReport& report = world.step();
    EXPECT_TRUE(is_by_events(world)) << depth;
    EXPECT_NEAR(world.state(below).position.z(), 0.2, 2e-9) << depth;
    EXPECT_NEAR(world.state(above).position.z(), 0.6, 4e-9) << depth;
    EXPECT_NEAR(report.energy.correction_work, kGravity * (2.0 * depth + 3.0 * depth), 1e-7)
        << depth;
    EXPECT_NEAR(world.energy() - report.energy.correction_work, before, 1e-10) << depth;
    for (int i = 0; i < 100; ++i) {
      world.step();
      EXPECT_EQ(world.report().energy.rise, 0.0);
      EXPECT_TRUE(is_by_events(world)) << depth;
    }
    EXPECT_LT(world.state(above).linear_velocity.norm(), 1e-12);
  }
}

// An overlap deeper than that of impulses at rest is not closed in one step.
TEST(ContactHandover, WhatIsMuchTooDeepIsLeftAndToldSo) {
  World world(by_auto(0.01));
  world.add_body(with_surface(make_floor(0.0), 0.5, 0.0));
  world.add_body(box_at("box", {0.0, 0.0, 0.19}));
  world.step();
  EXPECT_EQ(world.islands().front().why, MethodReason::kOverlap);
  EXPECT_EQ(world.report().contacts.handed_over, 0u);  // the contact was never event-driven
  for (int i = 0; i < 500; ++i) world.step();
  EXPECT_TRUE(is_by_events(world));
}

/// Six balls at rest in a row, and three more thrown past them, near enough for a group of nine,
/// which is too many: the group switches to impulses, and back to events once the three are gone.
World balls_that_pass(double h, double* weight) {
  World world(by_auto(h));
  world.add_body(with_surface(make_floor(0.0), 0.5, 0.0));
  const auto add = [&](const std::string& name, const Vector3d& at, double speed) {
    Body ball = with_surface(make_body(name, Sphere{0.1}, 1.0, at), 0.5, 0.0);
    ball.state.linear_velocity.y() = speed;
    *weight += kGravity * ball.mass;
    world.add_body(ball);
  };
  for (int i = 0; i < 6; ++i) add("lies" + std::to_string(i), {0.2001 * i, 0.0, 0.1}, 0.0);
  for (int i = 0; i < 3; ++i) add("flies" + std::to_string(i), {0.4 * i, -3.0, 0.8}, 10.0);
  return world;
}

// External work is reported, so energy less the reported work never rises; a copy and a snapshot,
// every 25 steps, continue with the same bits.
TEST(ContactHandover, GoesBothWaysAtNoCostInEnergy) {
  for (const double h : {0.01, 0.005}) {
    double weight = 0.0;
    World world = balls_that_pass(h, &weight);
    unsigned handed_over = 0, named = 0, taken_back = 0, switches = 0;
    std::set<std::uint32_t> away;  // bodies advanced by impulses, according to events
    bool was_by_impulses = false;
    double booked = 0.0, least = world.energy();
    World copy = world, again = world;
    for (int i = 0; world.time() < 10.0; ++i) {
      const StepReport& report = world.step();
      handed_over += report.contacts.handed_over;
      for (const StepWarning& warning : world.warnings())
        named += warning.kind == StepWarning::Kind::kHandedOver
                     ? static_cast<unsigned>(std::lround(warning.value))
                     : 0u;
      const bool is_now = is_by_impulses(world);
      // switches alternate for each body, at the beginning of a step
      std::array<unsigned, 2> told{};
      for (const Event& event : world.events()) {
        const bool goes = event.kind == EventKind::kHandedOver;
        if (!goes && event.kind != EventKind::kTakenBack) continue;
        ++told[goes ? 0 : 1];
        EXPECT_DOUBLE_EQ(event.time, world.time() - world.options().time_step) << world.time();
        EXPECT_EQ(event.body_a, event.body_b);
        const std::uint32_t body = event.body_a.value;
        EXPECT_TRUE(goes ? away.insert(body).second : away.erase(body) > 0) << world.time();
      }
      EXPECT_EQ(told[0], report.contacts.handed_over);
      taken_back += told[1];
      switches += is_now != was_by_impulses;
      was_by_impulses = is_now;
      booked += report.energy.correction_work + report.energy.driven_work;
      EXPECT_LT(world.energy() - booked, least + 1e-9 * weight) << h << ", " << world.time();
      least = std::min(least, world.energy() - booked);
      for (World* each : {&copy, &again})
        if (i > 0) each->step();
      ASSERT_EQ(i > 0 ? copy.state_hash() : 0, i > 0 ? world.state_hash() : 0) << world.time();
      ASSERT_EQ(i > 0 ? again.state_hash() : 0, i > 0 ? world.state_hash() : 0) << world.time();
      if (i % 25 != 0) continue;
      copy = world;
      again = read_snapshot(write_snapshot(world));
    }
    EXPECT_GE(handed_over, 6u) << h;
    EXPECT_EQ(named, handed_over) << h;
    EXPECT_EQ(handed_over, taken_back + away.size()) << h;
    EXPECT_TRUE(away.empty()) << h;
    EXPECT_GE(switches, 2u) << h;
    EXPECT_LE(switches, 6u) << h;  // once for the resting balls, and once for each that lands
    EXPECT_TRUE(!is_by_impulses(world)) << h;
    for (int i = 0; i < 6; ++i)
      EXPECT_NEAR(world.state(world.find_body("lies" + std::to_string(i))).position.z(), 0.1, 1e-9);
  }
}

// Impulses leave ½ g h² to g h² of overlap, which bodies would keep if they slept at once.
TEST(ContactHandover, NothingFallsAsleepInAnOverlap) {
  for (const double sleep_after : {0.3, 0.5}) {
    double weight = 0.0;
    World world = balls_that_pass(0.01, &weight);
    WorldOptions options = world.options();
    options.sleep_after = sleep_after;
    world.set_options(options);
    unsigned handed_over = 0;
    while (world.time() < 4.0) handed_over += world.step().contacts.handed_over;
    EXPECT_GE(handed_over, 6u);
    for (int i = 0; i < 6; ++i) {
      const BodyId ball = world.find_body("lies" + std::to_string(i));
      EXPECT_NEAR(world.state(ball).position.z(), 0.1, 1e-9) << sleep_after;
    }
    EXPECT_GE(world.report().costs.asleep, 1u) << sleep_after;
  }
}

}  // namespace
}  // namespace constraint_sim::engine
