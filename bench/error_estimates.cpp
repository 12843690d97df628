// Prints the ratio of estimated to actual local error per tick; the exact tick is eight eighths at
// a tolerance of 1e-13 m/s.

#include <cstdio>

#include "problems.h"

namespace constraint_sim::engine {
namespace {

constexpr double kDuration = 5.0;  // [s]

World with(World world, double time_step, double tolerance, int order) {
  WorldOptions options = world.options();
  options.time_step = time_step;
  options.tolerance = tolerance;
  options.order = order;
  world.set_options(options);
  return world;
}

void print_line(const char* name, World world) {
  const WorldOptions options = world.options();
  std::vector<double> ratios;
  for (int i = 0; i < static_cast<int>(kDuration / options.time_step); ++i) {
    World exact = with(world, options.time_step / 8.0, 1e-13, 8);
    for (int k = 0; k < 8; ++k) exact.step();
    const double estimate = world.step().local_error;
    const double error = problems::largest_difference(world, exact);
    if (error > 1e-13) ratios.push_back(estimate / error);  // smaller errors are rounding
  }
  std::sort(ratios.begin(), ratios.end());
  std::printf("%-16s %5d %8.3f %9.0e %6zu", name, options.order, options.time_step,
              options.tolerance, ratios.size());
  if (ratios.size() >= 20) {
    const std::size_t twentieth = ratios.size() / 20;
    const auto is_within = [](double ratio) { return ratio >= 0.1 && ratio <= 30.0; };
    const auto within = std::count_if(ratios.begin(), ratios.end(), is_within);
    std::printf(" %10.2f %10.2f %10.2f %10.2f %10.2f %9.1f %%", ratios.front(), ratios[twentieth],
                ratios[ratios.size() / 2], ratios[ratios.size() - 1 - twentieth], ratios.back(),
                100.0 * static_cast<double>(within) / static_cast<double>(ratios.size()));
  }
  std::printf("\n");
}

}  // namespace
}  // namespace constraint_sim::engine

int main() {
  using namespace constraint_sim::engine;
  std::printf("%-16s %5s %8s %9s %6s %10s %10s %10s %10s %10s %11s\n", "scene", "order", "tick",
              "tolerance", "ticks", "least", "5 %", "median", "95 %", "most", "0.1 to 30");
  const std::pair<const char*, World> scenes[] = {{"free_box", problems::free_box()},
                                                  {"pendulum", problems::chain(1)},
                                                  {"double_pendulum", problems::chain(2)},
                                                  {"chain_10", problems::chain(10)}};
  for (const int order : {8, 5})
    for (const auto& [name, scene] : scenes)
      for (const double time_step : {0.1, 1.0 / 30.0})
        for (const double tolerance : {1e-6, 1e-9})
          print_line(name, with(scene, time_step, tolerance, order));
}
