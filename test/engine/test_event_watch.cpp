// Times at which watched values reach their levels, from closed forms of motion at a constant
// acceleration.

#include <gtest/gtest.h>

#include <cmath>

#include "constraint_sim/engine/world.h"
#include "engine/methods/event_driven/event_watch.h"
#include "support.h"

namespace constraint_sim::engine {
namespace {

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
