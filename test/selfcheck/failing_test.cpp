#include <gtest/gtest.h>

TEST(Failing, Passes) { EXPECT_EQ(2 * 2, 4); }

TEST(Failing, FailsOnPurpose) { EXPECT_EQ(2 * 2, 5); }
