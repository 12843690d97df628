#include <gtest/gtest.h>

#include <cmath>
#include <limits>

#include "sim/stamps.h"

namespace constraint_sim {
namespace {

constexpr std::int64_t kSecond = 1000000000;

TEST(Stamps, FollowSimulatedTimeEvenlyThoughTheWallJitters) {
  Stamps stamps(Stamps::Source::kWall, 2.0);
  const std::int64_t first = stamps.next(100 * kSecond, 5.0, true);
  EXPECT_EQ(first, 100 * kSecond);
  // a simulated second is half a wall second, whatever wall time passes meanwhile
  EXPECT_EQ(stamps.next(101 * kSecond + 7, 6.0, true), first + kSecond / 2);
}

TEST(Stamps, NeverRepeatNorGoBack) {
  Stamps stamps(Stamps::Source::kWall, 1.0);
  const std::int64_t first = stamps.next(100 * kSecond, 5.0, true);
  EXPECT_EQ(stamps.next(100 * kSecond, 5.0, true), first + 1);
  // paused, wall time set back
  EXPECT_EQ(stamps.next(90 * kSecond, 1.0, false), first + 2);
}

// Python's tf2 takes stamps as doubles of seconds.
TEST(Stamps, DifferAsDoublesOfSeconds) {
  for (const std::int64_t now : {1795709315 * kSecond, 4294967290 * kSecond}) {
    Stamps stamps(Stamps::Source::kWall, 1.0);
    double last = 1e-9 * static_cast<double>(stamps.next(now, 5.0, false));
    for (int k = 0; k < 1000; ++k) {
      const double next = 1e-9 * static_cast<double>(stamps.next(now, 5.0, false));
      EXPECT_GT(next, last) << k;
      last = next;
    }
  }
}

TEST(Stamps, TakeTheWallAgainAfterAPauseADropOrAnotherScene) {
  Stamps stamps(Stamps::Source::kWall, 1.0);
  stamps.next(100 * kSecond, 5.0, true);
  stamps.next(160 * kSecond, 5.0, false);
  EXPECT_EQ(stamps.next(170 * kSecond, 5.01, true), 170 * kSecond);
  stamps.let_go();
  EXPECT_EQ(stamps.next(180 * kSecond, 5.02, true), 180 * kSecond);
}

TEST(Stamps, OfTheWallGoOnWhenSimulatedTimeGoesBack) {
  Stamps stamps(Stamps::Source::kWall, 1.0);
  stamps.next(100 * kSecond, 50.0, true);
  EXPECT_EQ(stamps.next(101 * kSecond, 0.01, true), 101 * kSecond);
}

TEST(Stamps, OfAWorldBetweenTwoMessagesLieBetweenTheirs) {
  Stamps wall(Stamps::Source::kWall, 2.0);
  EXPECT_EQ(wall.of(90 * kSecond, 4.0), 90 * kSecond);  // no relation to simulated time yet
  wall.next(100 * kSecond, 5.0, true);
  EXPECT_EQ(wall.of(102 * kSecond, 6.0), 100 * kSecond + kSecond / 2);
  EXPECT_EQ(wall.of(102 * kSecond, 1.0), 102 * kSecond);  // simulated time went back
  EXPECT_EQ(wall.next(102 * kSecond, 7.0, true), 101 * kSecond);
  wall.let_go();
  EXPECT_EQ(wall.of(103 * kSecond, 7.0), 103 * kSecond);

  Stamps simulated(Stamps::Source::kSimulated, 2.0);
  EXPECT_EQ(simulated.of(100 * kSecond, 2.5), 5 * kSecond / 2);
}

TEST(Stamps, OfSimulatedTimeAreItselfAndANanosecondOnWhereItStands) {
  Stamps stamps(Stamps::Source::kSimulated, 1.0);
  EXPECT_EQ(stamps.next(100 * kSecond, 0.0, false), 1);  // 0 means no time in ROS
  EXPECT_EQ(stamps.next(100 * kSecond, 2.5, true), 5 * kSecond / 2);
  EXPECT_EQ(stamps.next(101 * kSecond, 2.5, false), 5 * kSecond / 2 + 1);
  EXPECT_EQ(stamps.next(102 * kSecond, 2.51, true), 251 * kSecond / 100);
}

TEST(Stamps, OfSimulatedTimeGoBackWithIt) {
  Stamps stamps(Stamps::Source::kSimulated, 1.0);
  stamps.next(100 * kSecond, 50.0, true);
  EXPECT_EQ(stamps.next(101 * kSecond, 0.5, true), kSecond / 2);
}

TEST(Stamps, StandAtTheLastMomentThatAStampCanTell) {
  for (const Stamps::Source source : {Stamps::Source::kSimulated, Stamps::Source::kWall}) {
    Stamps stamps(source, 1.0);
    stamps.next(1000, 0.0, true);
    for (const double time : {4294967296.0, 1e10, 1e300, std::numeric_limits<double>::infinity()})
      EXPECT_EQ(stamps.next(1000, time, true), Stamps::kLast) << time;
  }
  EXPECT_EQ(Stamps::nanoseconds(std::nan("")), 0);
  EXPECT_EQ(Stamps::nanoseconds(-1.0), 0);
  EXPECT_EQ(Stamps::nanoseconds(1.5), 1500000000);
}

}  // namespace
}  // namespace constraint_sim
