// Stages of a substep that show a force beyond its bound, which is within it at both ends. Times at
// which values reach their levels, from closed forms of motion at a constant acceleration.

#include <gtest/gtest.h>

#include <cmath>

#include "constraint_sim/engine/world.h"
#include "engine/methods/event_driven/event_watch.h"
#include "support.h"

namespace constraint_sim::engine {
namespace {

constexpr int kOrders[] = {5, 8};

double share_of(int order, std::size_t stage) {
  return order == 8 ? DormandPrince8::kC[stage] : DormandPrince5::kC[stage];
}

/// Margin of a force whose lowest value, at a share of the substep, is `least`.
double early(int order, double share, double least) {
  const auto margin_at = [&](double c) { return least + (c - share) * (c - share); };
  return StagedSubstep(0.1, order)
      .early_below([&](std::size_t i) { return margin_at(share_of(order, i)); }, margin_at(1.0),
                   1e-9);
}

TEST(StagedSubstep, FindsAStageBelowZero) {
  EXPECT_EQ(early(8, 0.3333333333333333, -1e-3), DormandPrince8::kC[5]);
  EXPECT_EQ(early(8, 0.08, -1e-4), DormandPrince8::kC[2]);
  EXPECT_EQ(early(5, 0.29, -1e-3), DormandPrince5::kC[2]);
}

// No stage is within 0.05 of these places, so only a parabola through stages is below zero there.
TEST(StagedSubstep, FindsTheLowestPlaceBetweenStages) {
  for (const double share : {0.45, 0.5, 0.75}) EXPECT_NEAR(early(8, share, -1e-3), share, 1e-12);
  for (const double share : {0.4, 0.5, 0.7}) EXPECT_NEAR(early(5, share, -1e-3), share, 1e-12);
}

TEST(StagedSubstep, LeavesAMarginAboveZero) {
  for (const int order : kOrders)
    for (const double share : {0.0, 0.2, 0.45, 0.5, 0.75, 1.0})
      EXPECT_EQ(early(order, share, 1e-6), 0.0);
}

// A force far within its bounds costs two stages.
TEST(StagedSubstep, AsksFewStagesOfAQuietMargin) {
  for (const int order : kOrders) {
    int asked = 0;
    const auto margin = [&](std::size_t i) {
      ++asked;
      return 1.0 + 0.1 * share_of(order, i);
    };
    EXPECT_EQ(StagedSubstep(0.1, order).early_below(margin, 1.1, 1e-9), 0.0);
    EXPECT_EQ(asked, 2);
  }
}

// Margins that only fall or rise have an event at their end, or none.
TEST(StagedSubstep, LeavesAMarginWithoutALowestPlace) {
  for (const int order : kOrders)
    for (const double slope : {-1.0, 1.0}) {
      const auto margin = [&](std::size_t i) { return 2.0 + slope * share_of(order, i); };
      EXPECT_EQ(StagedSubstep(0.1, order).early_below(margin, 2.0 + slope, 1e-9), 0.0);
    }
}

TEST(StagedSubstep, KnowsTheTimesOfItsStages) {
  EXPECT_EQ(StagedSubstep(0.5, 5).until_end(0), 0.0);
  EXPECT_EQ(StagedSubstep(0.5, 5).until_end(1), 0.4);
  EXPECT_EQ(StagedSubstep().early_below([](std::size_t) { return -1.0; }, -1.0, 0.0), 0.0);
}

// ---- expected events

WatchedValue watched(int known, double value, double rate, double acceleration = 0.0) {
  WatchedValue watched;
  watched.known = known;
  watched.value = value;
  watched.rate = rate;
  watched.acceleration = acceleration;
  return watched;
}

TEST(ExpectedEvent, IsWhereAConstantAccelerationLeads) {
  const auto time = [](const WatchedValue& start, double level = 0.0) {
    return event_watch::time_to_level(start, level);
  };
  EXPECT_EQ(time(watched(1, 3.0, -2.0)), 1.5);
  EXPECT_EQ(time(watched(1, 3.0, -2.0), 1.0), 1.0);
  EXPECT_EQ(time(watched(1, 3.0, 2.0)), kInfinity);
  EXPECT_EQ(time(watched(1, 0.0, -2.0)), kInfinity);  // at its level
  EXPECT_EQ(time(watched(2, 3.0, -2.0)), 1.5);
  EXPECT_DOUBLE_EQ(time(watched(2, 8.0, 0.0, -4.0)), 2.0);
  EXPECT_DOUBLE_EQ(time(watched(2, 6.0, -1.0, -4.0)), 1.5);
  EXPECT_DOUBLE_EQ(time(watched(2, 6.0, 1.0, -4.0)), 2.0);
  EXPECT_DOUBLE_EQ(time(watched(2, 2.0, -3.0, 2.0)), 1.0);     // the first of two times
  EXPECT_EQ(time(watched(2, 3.0, -3.0, 2.0)), kInfinity);      // turns before
  EXPECT_EQ(time(watched(2, 3.0, 1.0, 1.0)), kInfinity);       // leaves
  EXPECT_DOUBLE_EQ(time(watched(2, -1e-17, 3.0, -2.0)), 3.0);  // leaves its level and returns
  EXPECT_EQ(time(watched(2, 0.0, -3.0, -2.0)), kInfinity);
  EXPECT_EQ(time(watched(0, 3.0, -2.0, -2.0)), kInfinity);  // a force has no known derivative
  // A slight acceleration, of either sign, changes the time by its first order: no cancellation.
  for (const double a : {-1e-9, 1e-9})
    EXPECT_NEAR(time(watched(2, 3.0, -2.0, a)), 1.5 + 0.5 * a * 1.5 * 1.5 / 2.0, 1e-15);
}

// A ball in free fall is at each bounce at the end of a substep, which is not repeated: a tick has
// a substep for each bounce in it, and one for the rest of the tick.
TEST(ExpectedEvent, EndsASubstepAtOnce) {
  WorldOptions falling = options(0.1);
  falling.method = Method::kEventDriven;
  falling.sleep_after = kInfinity;
  World world(falling);
  world.add_body(make_floor(0.0));
  Body ball = make_body("ball", Sphere{0.5}, 1.0, {0.0, 0.0, 1.5});
  ball.restitution = 0.5;
  world.add_body(ball);
  unsigned substeps = 0, events = 0, ticks = 0;
  for (; world.time() < 1.4; ++ticks) {
    const StepReport& report = world.step();
    substeps += report.costs.substeps + report.costs.rejected;
    events += report.costs.events;
  }
  EXPECT_GE(events, 4u);
  EXPECT_LE(substeps, ticks + events);
}

}  // namespace
}  // namespace constraint_sim::engine
