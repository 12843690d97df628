// Conservation by energy_momentum for each kind of joint and for loops, over thousands of steps.

#include "conserved_mechanisms.h"
#include "sanitized.h"
#include "support.h"

namespace constraint_sim::engine::mechanisms {
namespace {

// Bounds: 1e4 steps with a rounding error of 1e-16 each, some of which accumulate: energy 1.1e-12
// of the kinetic energy, angular momentum 1.1e-11 about an origin that bodies leave by 20 m and
// more. Bodies that slide 2 km have rounding errors of that distance. In the extreme scene, whose
// light box turns at up to 1e4 rad/s, substeps may take over some ticks, which is reported.
TEST(Conserved, AreEnergyAndMomentaOfAllKinds) {
  for (Conserved scene : conserved()) {
    scene.steps /= kSanitizedShare > 1 ? kSanitizedShare : kIsLongRun ? 1 : 4;
    const Kept kept = run(scene);
    const std::string& name = scene.mechanism.name;
    const bool is_extreme = scene.tolerance > 0.0;
    EXPECT_FALSE(kept.has_failed) << name;
    EXPECT_LE(kept.energy, is_extreme ? 3e-10 : 5e-12) << name;
    EXPECT_LE(kept.joints, 1e-12 + 4.0 * kEpsilon * kept.size) << name;
    EXPECT_LE(kept.iterations, 4.5) << name;
    if (is_extreme) {
      EXPECT_LE(kept.changes, 10u) << name;
    } else {
      EXPECT_EQ(kept.halvings, 0u) << name;
      EXPECT_EQ(kept.changes, 0u) << name;
    }
    if (!scene.is_free) continue;
    EXPECT_LE(kept.momentum, 1e-12) << name;
    EXPECT_LE(kept.angular_momentum, 3e-11) << name;
  }
}

}  // namespace
}  // namespace constraint_sim::engine::mechanisms
