// Prints the cost of a step of a chain as the chain grows. Arguments LINKS STEPS: only takes these
// steps, for bench/chain_instructions.py to count.

#include <chrono>
#include <cstdio>
#include <cstdlib>

#include "problems.h"

namespace constraint_sim::engine {
namespace {

World chain(int links) {
  World world = problems::chain(links);
  WorldOptions options = world.options();
  options.time_step = 1e-3;
  options.tolerance = 0.0;
  world.set_options(options);
  world.step();
  return world;
}

void print_times() {
  std::printf("%10s %14s %14s %14s\n", "links", "us per step", "ns per link", "worst rod [m]");
  for (const int links : {10, 100, 1000, 10000, 100000}) {
    World world = chain(links);
    const int steps = std::max(3, 100000 / links);
    double best = 1e300;
    for (int repetition = 0; repetition < 5; ++repetition) {
      const auto start = std::chrono::steady_clock::now();
      for (int i = 0; i < steps; ++i) world.step();
      const std::chrono::duration<double, std::micro> taken =
          std::chrono::steady_clock::now() - start;
      best = std::min(best, taken.count() / steps);
    }
    std::printf("%10d %14.2f %14.1f %14.1e\n", links, best, 1e3 * best / links,
                world.report().joints.max_error);
  }
}

}  // namespace
}  // namespace constraint_sim::engine

int main(int argc, char** argv) {
  using namespace constraint_sim::engine;
  if (argc == 3) {
    World world = chain(std::atoi(argv[1]));
    for (int i = 0; i < std::atoi(argv[2]); ++i) world.step();
  } else {
    print_times();
  }
  return 0;
}
