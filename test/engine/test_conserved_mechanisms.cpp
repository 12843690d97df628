// What energy_momentum keeps of each kind of joint and of loops, over thousands of steps.

#include "conserved_mechanisms.h"
#include "sanitized.h"
#include "support.h"

namespace constraint_sim::engine::mechanisms {
namespace {

// 1e4 steps of rounding, of which each leaves 1e-15 and some add up: energy 7e-12 of the kinetic
// energy, angular momentum 2e-11 about an origin that the bodies leave by 20 m and more. Boxes that
// slide apart in a plane are 80 m from each other at the end; Newton's method ends then with rows
// off by 5e-12 m and no longer by rounding alone.
TEST(Conserved, AreEnergyAndMomentaOfAllKinds) {
  for (Conserved scene : conserved()) {
    scene.steps /= kSanitizedShare;
    const Kept kept = run(scene);
    const std::string& name = scene.mechanism.name;
    const bool has_long_arms = name == "planar" || name == "point_on_plane";
    const bool is_extreme = scene.tolerance > 0.0;
    EXPECT_FALSE(kept.has_failed) << name;
    EXPECT_LE(kept.energy, has_long_arms || is_extreme ? 3e-10 : 3e-11) << name;
    EXPECT_LE(kept.joints, (has_long_arms ? 1e-11 : 1e-12) + 4.0 * kEpsilon * kept.size) << name;
    EXPECT_LE(kept.iterations, 4.5) << name;
    if (!is_extreme) {
      EXPECT_EQ(kept.halvings, 0u) << name;
    }
    if (!scene.is_free) continue;
    EXPECT_LE(kept.momentum, 1e-12) << name;
    EXPECT_LE(kept.angular_momentum, has_long_arms ? 5e-10 : 5e-11) << name;
  }
}

}  // namespace
}  // namespace constraint_sim::engine::mechanisms
