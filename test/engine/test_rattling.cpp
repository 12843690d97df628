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

// The first event follows none; the 15th one after it and each further one double the speed.
TEST(Rattling, DoublesTheSpeedThatCountsAsZero) {
  EXPECT_EQ(zero_speed_after(15, 1e-6, 1e-8), 1e-9);
  EXPECT_EQ(zero_speed_after(16, 1e-6, 1e-8), 2e-9);
  EXPECT_EQ(zero_speed_after(17, 1e-6, 1e-8), 4e-9);
}

// A box that rocks to rest hits faster at first: those events count too.
TEST(Rattling, CountsEventsThatAreFaster) {
  Rattling rattling;
  for (int i = 0; i < 16; ++i) EXPECT_EQ(rattling.zero_speed(1e-6 * i, 1e-3, 1e-9, 1e-6), 1e-9);
  EXPECT_EQ(rattling.zero_speed(1.6e-5, 1e-7, 1e-9, 1e-6), 2e-9);
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
// makes the tolerance eight times as large, up to 512 times; that of a gap doubles.
TEST(EventLevel, WidensWhereEventsChangeNothing) {
  WatchedValue force;
  force.value = -1e-9;
  force.tolerance = 1e-9;
  EXPECT_EQ(event_watch::level_of(force, 0), -1e-9);
  EXPECT_NEAR(event_watch::level_of(force, 1), -2e-9, 1e-20);
  EXPECT_NEAR(event_watch::level_of(force, 2), -9e-9, 1e-20);
  EXPECT_NEAR(event_watch::level_of(force, 3), -65e-9, 1e-20);
  EXPECT_NEAR(event_watch::level_of(force, 4), -513e-9, 1e-20);
  EXPECT_EQ(event_watch::level_of(force, 5), event_watch::level_of(force, 4));
  WatchedValue gap;
  gap.known = 2;
  EXPECT_NEAR(event_watch::level_of(gap, 2), -2.0 * gap.touching, 1e-20);
  EXPECT_NEAR(event_watch::level_of(gap, 10), -512.0 * gap.touching, 1e-20);
  EXPECT_EQ(event_watch::level_of(gap, 11), event_watch::level_of(gap, 10));
}

}  // namespace
}  // namespace constraint_sim::engine
