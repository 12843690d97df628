// Prints the cost and error of a heavy load on light links: energy_momentum beside runge_kutta,
// which resolves the motion of the links.

#include <chrono>
#include <cstdio>

#include "problems.h"

namespace constraint_sim::engine {
namespace {

constexpr int kRepetitions = 5;      // runs per setting; the fastest counts
constexpr double kDuration = 5.0;    // [s]
constexpr int kSamples = 50;         // number of samples of the error
constexpr double kLongestRun = 2e6;  // longer runs are not repeated [µs]

struct Setting {
  const char* name;
  Method method;
  int rate;  // [1/s]
  int stiff_order;
  double tolerance;  // [m/s]; 0: one substep a tick
};

constexpr Setting kSettings[] = {
    {"auto, tolerance 1e-8", Method::kAuto, 30, 4, 1e-8},
    {"auto, tolerance 1e-4", Method::kAuto, 30, 4, 1e-4},
    {"energy_momentum, 2", Method::kEnergyMomentum, 30, 2, 1e-8},
    {"energy_momentum, 2", Method::kEnergyMomentum, 60, 2, 1e-8},
    {"energy_momentum, 2", Method::kEnergyMomentum, 240, 2, 1e-8},
    {"energy_momentum, 4", Method::kEnergyMomentum, 20, 4, 1e-8},
    {"energy_momentum, 4", Method::kEnergyMomentum, 30, 4, 1e-8},
    {"energy_momentum, 4", Method::kEnergyMomentum, 60, 4, 1e-8},
    {"runge_kutta, fixed", Method::kRungeKutta, 120, 4, 0.0},
    {"runge_kutta, fixed", Method::kRungeKutta, 400, 4, 0.0},
    {"runge_kutta, fixed", Method::kRungeKutta, 4000, 4, 0.0},
};

struct Result {
  double of_load = 0.0, of_links = 0.0;  // largest errors [m]
  double drift = 0.0;                    // change of energy over its scale
  double run_time = 0.0;                 // [µs] per simulated second
  double newton_steps = 0.0;             // Newton iterations per midpoint step
};

Result run(const World& scene, const Setting& setting,
           const std::vector<std::vector<Eigen::Vector3d>>& reference) {
  Result result;
  for (int i = 0; i < kRepetitions; ++i) {
    World world = scene;
    WorldOptions options;
    options.method = setting.method;
    options.time_step = 1.0 / setting.rate;
    options.stiff_order = setting.stiff_order;
    options.tolerance = setting.tolerance;
    world.set_options(options);
    const std::vector<BodyId> ids = world.body_ids();
    double taken = 0.0, iterations = 0.0, substeps = 0.0;
    const int ticks = static_cast<int>(std::lround(kDuration * setting.rate)) / kSamples;
    for (const auto& positions : reference) {
      const auto start = std::chrono::steady_clock::now();
      for (int k = 0; k < ticks; ++k) {
        const StepReport& report = world.step();
        iterations += report.costs.iterations;
        substeps += report.costs.substeps;
        result.drift = std::max(result.drift, std::abs(report.energy.drift));
      }
      taken += std::chrono::duration<double, std::micro>(std::chrono::steady_clock::now() - start)
                   .count();
      for (std::size_t k = 0; k < ids.size(); ++k) {
        const double error = (world.state(ids[k]).position - positions[k]).norm();
        double& largest = k + 1 == ids.size() ? result.of_load : result.of_links;
        largest = std::max(largest, error);
      }
    }
    if (i == 0 || taken / kDuration < result.run_time) result.run_time = taken / kDuration;
    result.newton_steps = iterations / substeps;
    if (taken > kLongestRun) break;
  }
  return result;
}

void print_table(double end_mass) {
  const World scene = problems::heavy_chain(end_mass, false);
  const auto reference = problems::heavy_chain_references(end_mass, false, kDuration, kSamples);
  for (const Setting& setting : kSettings) {
    const double h_omega = std::sqrt(4.0 * end_mass * problems::kGravity / 0.1) / setting.rate;
    if (setting.tolerance == 0.0 && h_omega > 5.9) continue;  // unstable
    const Result result = run(scene, setting, reference);
    std::printf("%8.0e  %-21s 1/%-5d %9.1f %10.1e %10.1e %10.1e %6.1f\n", end_mass, setting.name,
                setting.rate, result.run_time, result.of_load, result.of_links, result.drift,
                result.newton_steps);
  }
}

}  // namespace
}  // namespace constraint_sim::engine

int main() {
  std::printf("heavy chain, only the load moves at first; largest errors of 5 s at every 0.1 s\n");
  std::printf("%8s  %-21s %-7s %9s %10s %10s %10s %6s\n", "load/kg", "method", "tick", "us/s",
              "load/m", "links/m", "energy", "Newton");
  for (const double end_mass : {1e3, 1e4, 1e6}) constraint_sim::engine::print_table(end_mass);
}
