// Error against run time, for the pendulum with its closed form and, as the first argument, a
// scene.

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <optional>

#include "constraint_sim/scene.h"
#include "constraint_sim/world.h"

namespace constraint_sim::engine {
namespace {

using Eigen::Vector3d;

constexpr double kDuration = 10.0;  // [s]
constexpr int kRepetitions = 5;     // of each run, the fastest counts

/// Where the bob of pendulum() is after kDuration, by elliptic functions [m].
const Vector3d kPendulumAtEnd(-0.27508746257611686, 0.0, -0.961419205099125064);

/// 1 kg on a rod of 1 m, released from the horizontal at rest.
World pendulum() {
  World world;
  Body bob;
  bob.name = "bob";
  bob.mass = 1.0;
  bob.state.position = {-1.0, 0.0, 0.0};
  Joint rod;
  rod.name = "rod";
  rod.body_b = world.add_body(bob);
  world.add_joint(rod);
  return world;
}

struct Result {
  double joint_error = 0.0;   ///< largest of all steps [m]
  double energy_drift = 0.0;  ///< at the end [1]
  double run_time = 0.0;      ///< [µs] per simulated second
  bool failed = false;
  World end;
};

Result run_once(World world, int steps_per_second) {
  WorldOptions options = world.options();
  options.time_step = 1.0 / steps_per_second;
  world.set_options(options);

  Result result;
  const auto start = std::chrono::steady_clock::now();
  const int steps = static_cast<int>(std::lround(kDuration * steps_per_second));
  for (int i = 0; i < steps && !result.failed; ++i) {
    const StepReport& report = world.step();
    result.joint_error = std::max(result.joint_error, report.max_constraint_error);
    result.energy_drift = report.energy_drift;
    result.failed = report.failed;
  }
  const std::chrono::duration<double, std::micro> taken = std::chrono::steady_clock::now() - start;
  result.run_time = taken.count() / kDuration;
  result.end = std::move(world);
  return result;
}

Result run(const World& world, int steps_per_second) {
  Result result = run_once(world, steps_per_second);
  for (int i = 1; i < kRepetitions; ++i)
    result.run_time = std::min(result.run_time, run_once(world, steps_per_second).run_time);
  return result;
}

void print_table(const char* title, const World& world, const std::optional<Vector3d>& reference) {
  std::printf("%s, %.0f s, %s\n", title, kDuration, name(Method::kSequentialImpulses));
  std::printf("%9s", "step [s]");
  if (reference) std::printf(" %16s", "position [m]");
  std::printf(" %16s %16s %16s\n", "rods, worst [m]", "energy drift", "us per second");
  for (const int steps_per_second : {30, 100, 300, 1000, 3000}) {
    const Result result = run(world, steps_per_second);
    std::printf("   1/%-4d", steps_per_second);
    if (reference) {
      const BodyId bob = result.end.find_body("bob");
      std::printf(" %16.2e", (result.end.state(bob).position - *reference).norm());
    }
    std::printf(" %16.2e %+16.2e %16.1f%s\n", result.joint_error, result.energy_drift,
                result.run_time, result.failed ? "  failed" : "");
  }
  std::printf("\n");
}

int run_all(int argc, char** argv) {
  print_table("pendulum", pendulum(), kPendulumAtEnd);
  if (argc < 2) return 0;
  try {
    print_table(argv[1], load_scene_file(argv[1]), std::nullopt);
  } catch (const SceneError& error) {
    std::fprintf(stderr, "%s\n", error.what());
    return 2;
  }
  return 0;
}

}  // namespace
}  // namespace constraint_sim::engine

int main(int argc, char** argv) { return constraint_sim::engine::run_all(argc, argv); }
