// The closing rule for events without end, and values whose events change nothing.

#include <gtest/gtest.h>

#include "engine/collision/contact_tolerances.h"
#include "engine/methods/event_driven/event_watch.h"
#include "engine/methods/event_driven/rattling.h"

namespace constraint_sim::engine {
namespace {

/// Speed that counts as zero after `count` events, `apart` [s], of contacts with this speed [m/s].
double zero_speed_after(int count, double apart, double speed) {
  ContactTolerances within;
  Rattling rattling;
  for (int i = 0; i < count; ++i)
    within.coarsen(rattling.zero_speed(i * apart, speed, within.resting, within.rattling));
  return within.resting;
}

// The first event follows none, 20 more double the speed, and each further 4 do.
TEST(Rattling, DoublesTheSpeedThatCountsAsZero) {
  EXPECT_EQ(zero_speed_after(20, 1e-6, 1e-8), 1e-9);
  EXPECT_EQ(zero_speed_after(21, 1e-6, 1e-8), 2e-9);
  EXPECT_EQ(zero_speed_after(24, 1e-6, 1e-8), 2e-9);
  EXPECT_EQ(zero_speed_after(25, 1e-6, 1e-8), 4e-9);
}

TEST(Rattling, EndsAtASpeedThatMatters) {
  EXPECT_EQ(zero_speed_after(1000, 1e-6, 1e-8), 1e-6);
  EXPECT_EQ(zero_speed_after(1000, 1e-6, 2e-6), 1e-9);
}

TEST(Rattling, LeavesEventsThatAreApart) { EXPECT_EQ(zero_speed_after(1000, 1e-3, 1e-8), 1e-9); }

TEST(Rattling, ChangesNoTolerancesBeyondTheLimit) {
  ContactTolerances within;
  EXPECT_FALSE(within.coarsen(2e-6));
  EXPECT_EQ(within.resting, 1e-9);
  EXPECT_EQ(within.slipping, 1e-9);
}

// A small shape has smaller speeds.
TEST(Rattling, ScalesWithTheShape) {
  const ContactTolerances within(1e-4);  // a hundredth of the smallest size of constant tolerances
  EXPECT_NEAR(within.rattling, 1e-7, 1e-20);
}

// A force that starts at its bound may exceed it by its tolerance. Each event without a change
// doubles the tolerance, up to 512 times.
TEST(EventLevel, WidensWhereEventsChangeNothing) {
  WatchedValue force;
  force.value = -1e-9;
  force.tolerance = 1e-9;
  EXPECT_EQ(event_watch::level_of(force, 0), -1e-9);
  EXPECT_NEAR(event_watch::level_of(force, 1), -2e-9, 1e-20);
  EXPECT_NEAR(event_watch::level_of(force, 2), -3e-9, 1e-20);
  EXPECT_NEAR(event_watch::level_of(force, 3), -5e-9, 1e-20);
  EXPECT_NEAR(event_watch::level_of(force, 10), -513e-9, 1e-20);
  EXPECT_EQ(event_watch::level_of(force, 11), event_watch::level_of(force, 10));
}

}  // namespace
}  // namespace constraint_sim::engine
