// Stages of a substep that show a force beyond its bound, which is within it at both ends.

#include <gtest/gtest.h>

#include "engine/methods/event_driven/staged_substep.h"

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

// By order 3 only the middle is looked at beside the end.
TEST(StagedSubstep, LooksAtTheMiddleByOrder3) {
  const auto share_of_early = [](double middle) {
    return StagedSubstep(0.1, 3).early_below([=](std::size_t i) { return i == 1 ? middle : 1.0; },
                                             1.0, 1e-9);
  };
  EXPECT_EQ(share_of_early(-1e-3), 0.5);
  EXPECT_EQ(share_of_early(1e-3), 0.0);
  EXPECT_NEAR(StagedSubstep(0.1, 3).until_end(1), 0.05, 1e-16);
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

}  // namespace
}  // namespace constraint_sim::engine
