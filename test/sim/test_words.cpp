#include <gtest/gtest.h>

#include "sim/words.h"

namespace constraint_sim {
namespace {

const std::vector<std::string> kScenes{"pendulum", "double_pendulum", "bridge", "winch"};

TEST(Words, TheClosestIsProposedAndNothingFarAway) {
  EXPECT_EQ(closest("pendulm", kScenes), "pendulum");
  EXPECT_EQ(closest("Bridge", kScenes), "bridge");
  EXPECT_EQ(closest("double-pendulum", kScenes), "double_pendulum");
  EXPECT_EQ(closest("wnich", {"winch", "bridge"}), "");  // two letters of five are too many
  EXPECT_EQ(closest("falling_balls", kScenes), "");
  EXPECT_EQ(closest("", kScenes), "");
  EXPECT_EQ(closest(std::string(1 << 20, 'x'), kScenes), "");
  EXPECT_EQ(did_you_mean("pendulm", kScenes), "; did you mean 'pendulum'?");
  EXPECT_EQ(did_you_mean("x", kScenes), "");
}

TEST(Words, AQuoteIsOfFortyCharactersAtMostAndEndsBetweenTwo) {
  EXPECT_EQ(shortened("short"), "short");
  EXPECT_EQ(shortened(std::string(41, 'a')), std::string(40, 'a') + "...");
  EXPECT_EQ(shortened(std::string(39, 'a') + "\xc3\xa4z"), std::string(39, 'a') + "...");
  EXPECT_EQ(with_short_quotes("it's:1: got '" + std::string(99, 'a') + "'.", 5),
            "it's:1: got '" + std::string(40, 'a') + "...'.");
  EXPECT_EQ(with_short_quotes("got 'a'b' here"), "got 'a'b' here");
  EXPECT_EQ(with_short_quotes("nothing in quotes"), "nothing in quotes");
}

}  // namespace
}  // namespace constraint_sim
