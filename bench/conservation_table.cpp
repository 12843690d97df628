// Prints the errors of energy and momentum that energy_momentum leaves for each kind of joint, and
// the iterations of Newton's method. `constraint_sim_conservation_table [PART OF A NAME]`; exit
// status 1 where a run failed.

#include <cstdio>

#include "conserved_mechanisms.h"

int main(int argc, char** argv) {
  namespace mechanisms = constraint_sim::engine::mechanisms;
  const std::string part = argc > 1 ? argv[1] : "";
  bool has_failed = false;
  std::printf("%-24s %6s %6s %9s %9s %9s %9s %7s %7s %8s %7s\n", "scene", "tick", "steps", "energy",
              "momentum", "angular", "joints/m", "size/m", "Newton", "halvings", "changes");
  for (const mechanisms::Conserved& scene : mechanisms::conserved()) {
    if (scene.mechanism.name.find(part) == std::string::npos) continue;
    const mechanisms::Kept kept = run(scene);
    std::printf("%-24s %6.3f %6d %9.1e ", scene.mechanism.name.c_str(), scene.tick, scene.steps,
                kept.energy);
    if (scene.is_free)
      std::printf("%9.1e %9.1e", kept.momentum, kept.angular_momentum);
    else
      std::printf("%9s %9s", "-", "-");
    std::printf(" %9.1e %7.1f %7.2f %8u %7u%s\n", kept.joints, kept.size, kept.iterations,
                kept.halvings, kept.changes, kept.has_failed ? "  FAILED" : "");
    std::fflush(stdout);
    has_failed = has_failed || kept.has_failed;
  }
  return has_failed ? 1 : 0;
}
