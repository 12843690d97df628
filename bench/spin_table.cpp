// Prints errors of fast rotations by energy_momentum beside its error estimate, and whether the
// steps name the bodies as unresolved. An argument selects a scene by its name.

#include <cstdio>
#include <string>

#include "spinning_scenes.h"

namespace constraint_sim::engine::spinning {
namespace {

constexpr double kDuration = 0.1;  // [s]
constexpr double kSpeeds[] = {1e2, 1e3, 1e4, 1e5};

void print_line(const Named& scene, const Setting& setting) {
  Spinning made = scene.make(setting);
  const Seen seen = run(made, kDuration, setting.speed);
  std::printf("%-16s %-16s %8.0e %7.0f %10.1e %10.1e %10.1e %10.1e %9.2g %-6s %7u%s\n", scene.name,
              name(setting.method), setting.speed, 1.0 / setting.time_step, seen.angle, seen.speed,
              seen.error, seen.estimate, seen.error / seen.estimate, seen.is_named ? "named" : "-",
              seen.changes, seen.is_by_midpoint ? "" : "  other method");
}

}  // namespace
}  // namespace constraint_sim::engine::spinning

int main(int argc, char** argv) {
  using namespace constraint_sim::engine;
  using namespace constraint_sim::engine::spinning;
  std::printf("%-16s %-16s %8s %7s %10s %10s %10s %10s %9s %-6s %7s\n", "scene", "method", "rad/s",
              "1/tick", "angle/rad", "speed", "error/m", "estimate/m", "ratio", "names", "changes");
  for (const Named& scene : kSpinning) {
    if (argc > 1 && std::string(argv[1]) != scene.name) continue;
    for (const Method method : {Method::kEnergyMomentum, Method::kAuto}) {
      if (method == Method::kAuto && scene.make != beside_a_stiff_spring) continue;
      for (const double speed : kSpeeds)
        for (const double time_step : {1.0 / 30.0, 1.0 / 60.0, 1.0 / 240.0, 1.0 / 1000.0})
          print_line(scene, {method, time_step, speed});
    }
  }
}
