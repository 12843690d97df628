// Prints the wall time of a step of many islands by number of threads, and whether the state is the
// same.
//
//   constraint_sim_thread_scaling [ISLANDS]    10, 100, 1000 and 10000 by default

#include <chrono>
#include <cstdio>
#include <cstdlib>

#include "problems.h"

namespace constraint_sim::engine {
namespace {

constexpr int kSteps = 20, kRepetitions = 10;

/// Pendula, each on its own rod.
World pendula(int count, int threads) {
  WorldOptions options;
  options.time_step = 1.0 / 240.0;
  options.threads = threads;
  World world(options);
  for (int i = 0; i < count; ++i) {
    const std::string name = std::to_string(i);
    const BodyId bob = problems::add_mass(&world, "bob_" + name, {1.0, 0.0, 3.0 * i});
    Joint rod;
    rod.name = "rod_" + name;
    rod.anchor_a = {0.0, 0.0, 3.0 * i};
    rod.body_b = bob;
    world.add_joint(rod);
  }
  world.step();
  return world;
}

/// Returns the best of several times [µs].
double time_of_a_step(World* world) {
  double best = 1e300;
  for (int repetition = 0; repetition < kRepetitions; ++repetition) {
    const auto start = std::chrono::steady_clock::now();
    for (int i = 0; i < kSteps; ++i) world->step();
    const std::chrono::duration<double> time = std::chrono::steady_clock::now() - start;
    best = std::min(best, 1e6 * time.count() / kSteps);
  }
  return best;
}

void print(int count) {
  double alone = 0.0;
  std::uint64_t hash = 0;
  for (const int threads : {1, 2, 4}) {
    World world = pendula(count, threads);
    const double time = time_of_a_step(&world);
    if (threads == 1) {
      alone = time;
      hash = world.state_hash();
    }
    std::printf("%8d %8d %12.1f %8.2f %s\n", count, threads, time, alone / time,
                world.state_hash() == hash ? "same" : "DIFFERENT");
  }
}

}  // namespace
}  // namespace constraint_sim::engine

int main(int argc, char** argv) {
  std::printf("%8s %8s %12s %8s %s\n", "pendula", "threads", "us a step", "gain", "state");
  if (argc > 1) {
    constraint_sim::engine::print(std::atoi(argv[1]));
    return 0;
  }
  for (const int count : {10, 100, 1000, 10000}) constraint_sim::engine::print(count);
  return 0;
}
