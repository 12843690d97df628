// Prints errors of mechanisms by runge_kutta against minimal coordinates, by step and by tolerance.
// `constraint_sim_mechanism_table [PART OF A NAME]`; exit status 1 where a run failed.

#include <chrono>
#include <cstdio>

#include "coupled_mechanisms.h"
#include "flat_mechanisms.h"

namespace {

using constraint_sim::engine::mechanisms::Mechanism;
using constraint_sim::engine::mechanisms::Outcome;

bool print(const Mechanism& mechanism, double tick, double tolerance) {
  const auto start = std::chrono::steady_clock::now();
  const Outcome run = constraint_sim::engine::mechanisms::run(mechanism, tick, tolerance);
  const double taken =
      std::chrono::duration<double, std::milli>(std::chrono::steady_clock::now() - start).count();
  const bool is_met = !run.has_failed && run.dependent_rows == mechanism.dependent_rows;
  std::printf("%-26s 1/%-6.0f %9.0e %9.1e %s %9.1e %5u %9u %9u %9.1f%s\n", mechanism.name.c_str(),
              1.0 / tick, tolerance, run.error, mechanism.is_judged_by_angles ? "rad" : "m  ",
              run.joints, run.dependent_rows, run.substeps, run.rejected, taken,
              is_met ? "" : "  FAILED");
  std::fflush(stdout);
  return is_met;
}

}  // namespace

int main(int argc, char** argv) {
  namespace mechanisms = constraint_sim::engine::mechanisms;
  const std::string part = argc > 1 ? argv[1] : "";
  bool are_met = true;
  std::printf("%-26s %-8s %9s %13s %9s %5s %9s %9s %9s\n", "mechanism", "tick", "tolerance",
              "error", "joints/m", "left", "substeps", "rejected", "ms");
  for (const Mechanism& made :
       {mechanisms::double_hinge_pendulum(), mechanisms::spinning_top(), mechanisms::slider_crank(),
        mechanisms::four_bar(), mechanisms::universal_shaft(), mechanisms::bricard(),
        mechanisms::driven_slider_crank(), mechanisms::driven_universal_shaft(),
        mechanisms::squeezer(), mechanisms::with_couplings(mechanisms::planetary_gear()),
        mechanisms::with_couplings(mechanisms::falling_nut()),
        mechanisms::with_couplings(mechanisms::falling_rack()),
        mechanisms::with_couplings(mechanisms::swinging_atwood(1.0)),
        mechanisms::with_couplings(mechanisms::swinging_atwood(2.0)),
        mechanisms::parallelograms(1, 10.0), mechanisms::parallelograms(2, 10.0),
        mechanisms::parallelograms(40, 20.0)}) {
    if (made.name.find(part) == std::string::npos) continue;
    for (const double step : made.steps) are_met = print(made, step, 0.0) && are_met;
    const double tick = made.is_judged_by_angles ? 1.0 / 1000.0 : 1.0 / 30.0;
    for (const double tolerance : {1e-8, 1e-9}) are_met = print(made, tick, tolerance) && are_met;
  }
  return are_met ? 0 : 1;
}
