#include <gtest/gtest.h>

#include "sim/stamps.h"

namespace constraint_sim {
namespace {

constexpr std::int64_t kSecond = 1000000000;

TEST(Stamps, FollowSimulatedTimeEvenlyThoughTheWallJitters) {
  Stamps stamps(2.0);
  const std::int64_t first = stamps.next(100 * kSecond, 5.0, true);
  EXPECT_EQ(first, 100 * kSecond);
  // one simulated second is half a wall second, whatever the wall says meanwhile
  EXPECT_EQ(stamps.next(101 * kSecond + 7, 6.0, true), first + kSecond / 2);
}

TEST(Stamps, NeverRepeatNorGoBack) {
  Stamps stamps(1.0);
  const std::int64_t first = stamps.next(100 * kSecond, 5.0, true);
  EXPECT_EQ(stamps.next(100 * kSecond, 5.0, true), first + 1);
  EXPECT_EQ(stamps.next(90 * kSecond, 1.0, false), first + 2);  // paused, the wall set back
}

TEST(Stamps, TakeTheWallAgainAfterAPauseADropOrAnotherScene) {
  Stamps stamps(1.0);
  stamps.next(100 * kSecond, 5.0, true);
  stamps.next(160 * kSecond, 5.0, false);
  EXPECT_EQ(stamps.next(170 * kSecond, 5.01, true), 170 * kSecond);
  stamps.let_go();
  EXPECT_EQ(stamps.next(180 * kSecond, 5.02, true), 180 * kSecond);
}

}  // namespace
}  // namespace constraint_sim
