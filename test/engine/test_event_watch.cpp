// Stages of a substep that show a force beyond its bound, which is within it at both ends.

#include <gtest/gtest.h>

#include "engine/methods/event_driven/event_watch.h"

namespace constraint_sim::engine {
namespace {

/// Margin of a force whose lowest value, at a share of the substep, is `least`.
double early(double share, double least) {
  const auto margin_at = [&](double c) { return least + (c - share) * (c - share); };
  return early_below([&](std::size_t i) { return margin_at(DormandPrince8::kC[i]); },
                     margin_at(1.0), 1e-9);
}

TEST(EarlyBelow, FindsAStage) {
  EXPECT_EQ(early(0.3333333333333333, -1e-3), DormandPrince8::kC[5]);
  EXPECT_EQ(early(0.08, -1e-4), DormandPrince8::kC[2]);
}

// No stage is within 0.05 of these places, so only a parabola through stages is below zero there.
TEST(EarlyBelow, FindsTheLowestPlaceBetweenStages) {
  for (const double share : {0.45, 0.5, 0.75}) EXPECT_NEAR(early(share, -1e-3), share, 1e-12);
}

TEST(EarlyBelow, LeavesAMarginAboveZero) {
  for (const double share : {0.0, 0.2, 0.45, 0.5, 0.75, 1.0}) EXPECT_EQ(early(share, 1e-6), 0.0);
}

// A force far within its bounds costs two stages.
TEST(EarlyBelow, AsksFewStagesOfAQuietMargin) {
  int asked = 0;
  const auto margin = [&](std::size_t i) {
    ++asked;
    return 1.0 + 0.1 * DormandPrince8::kC[i];
  };
  EXPECT_EQ(early_below(margin, 1.1, 1e-9), 0.0);
  EXPECT_EQ(asked, 2);
}

// Margins that only fall or rise have an event at their end, or none.
TEST(EarlyBelow, LeavesAMarginWithoutALowestPlace) {
  for (const double slope : {-1.0, 1.0}) {
    const auto margin = [&](std::size_t i) { return 2.0 + slope * DormandPrince8::kC[i]; };
    EXPECT_EQ(early_below(margin, 2.0 + slope, 1e-9), 0.0);
  }
}

}  // namespace
}  // namespace constraint_sim::engine
