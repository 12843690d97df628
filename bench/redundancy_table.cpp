// Prints figures of scenes with redundant joints, singular poses and mass ratios, with bounds and
// run times. `constraint_sim_redundancy_table [--long] [PART OF A NAME]`, --long for 1000 s each;
// exit status 1 where a bound is exceeded. A run ends there, so its time means nothing.

#include <chrono>
#include <cstdio>
#include <string>

#include "redundant_cases.h"

int main(int argc, char** argv) {
  namespace redundant = constraint_sim::engine::redundant;
  const bool is_long = argc > 1 && std::string(argv[1]) == "--long";
  const int first = is_long ? 2 : 1;
  const std::string part = argc > first ? argv[first] : "";
  bool are_all_met = true;
  std::printf("%-28s %-7s %9s %9s %9s %9s %8s %9s\n", "scene", "tick", "joints/m", "(allowed)",
              "energy/J", "(allowed)", "changes", "ms");
  for (const redundant::Case& c : is_long ? redundant::long_cases() : redundant::all_cases()) {
    if (c.name.find(part) == std::string::npos) continue;
    const auto start = std::chrono::steady_clock::now();
    const redundant::Figures figures = measure(c);
    const double taken =
        std::chrono::duration<double, std::milli>(std::chrono::steady_clock::now() - start).count();
    const bool is_met = redundant::is_met(c, figures);
    are_all_met = are_all_met && is_met;
    std::printf("%-28s 1/%-5.0f %9.1e %9.1e %9.1e %9.1e %8u %9.1f%s%s\n", c.name.c_str(), c.rate,
                figures.joints, std::max(c.joints_allowed(), figures.round_off), figures.energy,
                std::max(c.energy_allowed(), 1e-12 * figures.scale), figures.changes, taken,
                figures.has_failed ? "  taken for contradictory" : "", is_met ? "" : "  NOT MET");
  }
  return are_all_met ? 0 : 1;
}
