#include <gtest/gtest.h>

#include "sim/condition.h"

namespace constraint_sim {
namespace {

using Change = Condition::Change;

TEST(Condition, IsToldOnceWhenItBeginsAndOnceWhenItEnds) {
  Condition condition;
  EXPECT_EQ(condition.update(false, 0.0), Change::kNone);
  EXPECT_EQ(condition.update(true, 1.0), Change::kBegan);
  EXPECT_EQ(condition.update(true, 100.0), Change::kNone);
  EXPECT_EQ(condition.update(false, 100.0 + 0.9 * Condition::kEndsAfter), Change::kNone);
  EXPECT_EQ(condition.update(false, 100.0 + 1.1 * Condition::kEndsAfter), Change::kEnded);
  EXPECT_EQ(condition.update(false, 200.0), Change::kNone);
  EXPECT_EQ(condition.update(true, 201.0), Change::kBegan);
}

TEST(Condition, ThatFlickersIsOne) {
  Condition condition;
  int told = 0;
  for (int i = 0; i < 1000; ++i)
    if (condition.update(i % 10 == 0, 0.01 * i) != Change::kNone) ++told;
  EXPECT_EQ(told, 1);
}

}  // namespace
}  // namespace constraint_sim
