#include <gtest/gtest.h>

// Own main function, since not every catkin links gtest's.
int main(int argc, char** argv) {
  testing::InitGoogleTest(&argc, argv);
  return RUN_ALL_TESTS();
}
