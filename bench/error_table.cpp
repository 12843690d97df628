// Prints the run time to reach an error, of each method on the smooth scenes of problems.h.

#include <chrono>
#include <cstdio>
#include <functional>

#include "hand_written.h"
#include "problems.h"

namespace constraint_sim::engine {
namespace {

constexpr int kRepetitions = 5;      // runs per setting; the fastest counts
constexpr double kLongestRun = 2.0;  // settings that take longer are not tried [s]
constexpr double kTargets[] = {1e-4, 1e-6, 1e-9};

struct Problem {
  const char* name;
  World world;
  double duration;                            // [s]
  std::function<double(const World&)> error;  // error at the end [m]
};

struct Setting {
  Method method;
  int order;
  int rate;        // [1/s], one substep a tick
  int iterations;  // iterations of sequential_impulses
};

struct Result {
  double error;     // [m]
  double run_time;  // [µs] per simulated second
};

World prepared(const Problem& problem, const Setting& setting) {
  World world = problem.world;
  WorldOptions options = world.options();
  options.method = setting.method;
  options.order = setting.order;
  options.tolerance = 0.0;
  options.iterations = setting.iterations;
  options.time_step = 1.0 / setting.rate;
  world.set_options(options);
  return world;
}

Result run(const Problem& problem, const Setting& setting) {
  Result result{0.0, 0.0};
  for (int i = 0; i < kRepetitions; ++i) {
    World world = prepared(problem, setting);
    const auto start = std::chrono::steady_clock::now();
    const int steps = static_cast<int>(std::lround(problem.duration * setting.rate));
    for (int k = 0; k < steps; ++k) world.step();
    const std::chrono::duration<double, std::micro> taken =
        std::chrono::steady_clock::now() - start;
    const double run_time = taken.count() / problem.duration;
    result.error = problem.error(world);
    if (i == 0 || run_time < result.run_time) result.run_time = run_time;
    if (taken.count() > 0.2e6) break;  // long enough to need no repetition
  }
  return result;
}

/// Prints the first setting, from the cheapest on, that reaches each target.
void print_line(const Problem& problem, const char* name, const std::vector<Setting>& settings) {
  struct Cell {
    double run_time = 0.0;
    int rate = 0;  // 0: not reached
  } cells[3];
  double best = 1e300;
  for (const Setting& setting : settings) {
    const Result result = run(problem, setting);
    best = std::min(best, result.error);
    for (int i = 0; i < 3; ++i)
      if (cells[i].rate == 0 && result.error <= kTargets[i])
        cells[i] = {result.run_time, setting.rate};
    if (cells[2].rate > 0 || result.run_time * problem.duration > kLongestRun * 1e6) break;
  }
  std::printf("%-18s %-22s", problem.name, name);
  for (const Cell& cell : cells) {
    if (cell.rate == 0)
      std::printf(" %18s", "-");
    else
      std::printf(" %9.1f at 1/%-4d", cell.run_time, cell.rate);
  }
  std::printf("   best %.1e\n", best);
}

std::vector<Setting> integrations(int order) {
  std::vector<Setting> settings;
  for (const int rate : {5, 8, 10, 15, 20, 30, 40, 60, 80, 100, 150, 200, 300, 500, 1000, 2000})
    settings.push_back({Method::kRungeKutta, order, rate, 10});
  return settings;
}

/// Settings of sequential_impulses; more links need more sweeps a step.
std::vector<Setting> impulses(int iterations) {
  std::vector<Setting> settings;
  for (const int rate : {30, 100, 300, 1000, 3000, 10000, 30000, 100000, 300000})
    settings.push_back({Method::kSequentialImpulses, 8, rate, iterations});
  return settings;
}

Problem chain(const char* name, int links, double duration) {
  const auto reference = problems::chain_reference(links, duration, 1.0 / 32.0);
  return {name, problems::chain(links), duration,
          [reference](const World& end) { return problems::largest_distance(end, reference); }};
}

Problem free_box() {
  return {"free_box_complex", problems::free_box(), 10.0, [](const World& end) {
            constexpr double kRadiusOfGyration = 0.2843;  // [m]
            return kRadiusOfGyration *
                   problems::angle_between(end.state(end.find_body("box")).orientation,
                                           problems::free_box_orientation());
          }};
}

void print_fixed_steps(const Problem& problem) {
  for (const int rate : {30, 100}) {
    const Result result = run(problem, {Method::kRungeKutta, 8, rate, 10});
    std::printf("%-18s 1/%-4d %12.1f %14.1e\n", problem.name, rate, result.run_time, result.error);
  }
}

/// Prints the fastest of interleaved runs of the engine and of a program for chains alone.
void print_beside_hand_written(const Problem& problem) {
  constexpr int kRate = 30;
  const auto links = problem.world.joint_ids().size();
  const Setting setting{Method::kRungeKutta, 8, kRate, 10};
  double engine = 1e300;
  double hand_written = 1e300;
  for (int i = 0; i < 4 * kRepetitions; ++i) {
    engine = std::min(engine, run(problem, setting).run_time);
    hand_written::Chain chain(links);
    const auto start = std::chrono::steady_clock::now();
    const int steps = static_cast<int>(std::lround(problem.duration * kRate));
    for (int k = 0; k < steps; ++k) chain.step(1.0 / kRate);
    const std::chrono::duration<double, std::micro> taken =
        std::chrono::steady_clock::now() - start;
    hand_written = std::min(hand_written, taken.count() / problem.duration);
  }
  std::printf("%-18s %10.1f %14.1f %8.2f\n", problem.name, engine, hand_written,
              engine / hand_written);
}

int print_all() {
  const Problem scenes[] = {free_box(), chain("pendulum", 1, 10.0),
                            chain("double_pendulum", 2, 3.0), chain("chain_10", 10, 2.0),
                            chain("chain_100", 100, 2.0)};
  std::printf("us of run time per simulated second to reach an error [m] at the end\n%-18s %-22s",
              "scene", "method");
  for (const double target : kTargets) std::printf(" %18.0e", target);
  std::printf("\n");
  for (const Problem& problem : scenes) {
    print_line(problem, "runge_kutta, order 8", integrations(8));
    print_line(problem, "runge_kutta, order 5", integrations(5));
    print_line(problem, "sequential_impulses",
               impulses(std::max(10, static_cast<int>(problem.world.joint_ids().size()))));
  }
  std::printf("\norder 8, one substep a tick\n%-18s %-6s %12s %14s\n", "scene", "tick", "us",
              "error [m]");
  for (const Problem& problem : scenes) print_fixed_steps(problem);
  std::printf("\norder 8 at 1/30 s, us per simulated second\n%-18s %10s %14s %8s\n", "scene",
              "engine", "hand-written", "ratio");
  for (const Problem& problem : scenes)
    if (!problem.world.joint_ids().empty()) print_beside_hand_written(problem);
  return 0;
}

}  // namespace
}  // namespace constraint_sim::engine

int main() { return constraint_sim::engine::print_all(); }
