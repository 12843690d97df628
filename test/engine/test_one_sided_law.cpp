// Laws whose force jumps at a rate: bounds of the force near a jump, and motors that brake to rest.

#include <gtest/gtest.h>

#include "engine/constraints/one_sided_law.h"

namespace constraint_sim::engine {
namespace {

constexpr double kFriction = 2.0, kDrive = 5.0;  // [N]

OneSidedLaw law_with_friction_and_motor() {
  OneSidedLaw law;
  law.friction = kFriction;
  law.drive = kDrive;
  return law;
}

Prescribed motion(double rate, double acceleration) { return {0.0, rate, acceleration}; }

// A coordinate that friction holds moves slower than its motor demands, which thus pushes.
TEST(ForceBounds, HaveOneSignBeyondAJump) {
  const OneSidedLaw law = law_with_friction_and_motor();
  const ForceBounds held = force_bounds(law, Hold::kStill, {}, motion(1.0, 0.0));
  EXPECT_EQ(held.least, kDrive - kFriction);
  EXPECT_EQ(held.most, kDrive + kFriction);
  const ForceBounds driven = force_bounds(law, Hold::kDrive, motion(-1.0, 0.0), motion(-1.0, 0.0));
  EXPECT_EQ(driven.least, -kDrive + kFriction);
  EXPECT_EQ(driven.most, kDrive + kFriction);
}

// A coordinate leaves two jumps that are nearer than kResting to the same side, so any sum of both
// forces may hold it until then.
TEST(ForceBounds, AreThoseOfBothSignsWhereJumpsAreNear) {
  const OneSidedLaw law = law_with_friction_and_motor();
  for (const double zeta : {-0.5 * kResting, 0.0, 0.5 * kResting}) {
    const ForceBounds bounds = force_bounds(law, Hold::kStill, {}, motion(zeta, 4.0));
    EXPECT_EQ(bounds.least, -kDrive - kFriction) << zeta;
    EXPECT_EQ(bounds.most, kDrive + kFriction) << zeta;
  }
}

// A motor that begins its motion from rest has friction against it at once.
TEST(ForceBounds, OpposeAMotionThatIsAboutToStart) {
  const OneSidedLaw law = law_with_friction_and_motor();
  for (const double side : {-1.0, 1.0}) {
    const Prescribed starts = motion(0.0, 0.1 * side);
    const ForceBounds bounds = force_bounds(law, Hold::kDrive, starts, starts);
    EXPECT_EQ(bounds.least, -kDrive - side * kFriction) << side;
    EXPECT_EQ(bounds.most, kDrive - side * kFriction) << side;
  }
}

// The rate of a braking coordinate falls to zero, but never changes its sign.
TEST(ForceBounds, OpposeBrakingUntilItsEnd) {
  const OneSidedLaw law = law_with_friction_and_motor();
  for (const double rate : {-1.0, -0.1 * kResting, 0.0}) {
    const Prescribed brakes = motion(rate, 8.0);
    const ForceBounds bounds = force_bounds(law, Hold::kBrake, brakes, brakes);
    EXPECT_EQ(bounds.least, -kDrive + kFriction) << rate;
    EXPECT_EQ(bounds.most, kDrive + kFriction) << rate;
  }
}

// With v² = 2 b x a body comes to rest over the distance x.
TEST(PositionMotor, BrakesWhereItComesToRestAtItsPosition) {
  const double braking = 8.0, off = 0.04, rate = 0.8;
  for (const double side : {-1.0, 1.0}) {
    EXPECT_TRUE(brakes_to_goal(side * off, -side * rate, braking));
    EXPECT_TRUE(brakes_to_goal(side * (off + 0.9 * kTouching), -side * rate, braking));
    EXPECT_FALSE(brakes_to_goal(side * (off + 1.1 * kTouching), -side * rate, braking));
    EXPECT_FALSE(brakes_to_goal(side * off, side * rate, braking)) << "it moves away";
    EXPECT_TRUE(brakes_to_goal(side * 1e-16, 0.0, braking)) << "the side is rounding";
    EXPECT_FALSE(brakes_to_goal(0.0, -side * 1e-3, braking)) << "it passes the position";
  }
}

TEST(PositionMotor, BrakesAgainstTheMotionAndStaysWhereItRests) {
  for (const double rate : {-0.8, 0.8}) {
    const Prescribed from = braking_from(0.3, rate, 8.0);
    EXPECT_EQ(from.value, 0.3);
    EXPECT_DOUBLE_EQ(from.rate, rate);
    EXPECT_EQ(from.acceleration, rate > 0.0 ? -8.0 : 8.0);
  }
  const Prescribed at_rest = braking_from(0.3, 0.5 * kResting, 8.0);
  EXPECT_EQ(at_rest.rate, 0.0);
  EXPECT_EQ(at_rest.acceleration, 0.0);
}

}  // namespace
}  // namespace constraint_sim::engine
