#pragma once

#include <cstddef>

#include "constraint_sim/engine/stop_flag.h"
#include "engine/math/numbers.h"

namespace constraint_sim::engine {

/// Budget and cost of a solution. The unit is a substep of a body with a contact, 7 µs.
struct SolveEffort {
  double most = kInfinity;
  StopFlag stop = nullptr;
  double spent = 0.0;

  bool is_over() const { return spent > most || is_set(stop); }
};

/// Returns the cost of a step of Newton's method for dense equations, fitted to 3, 18 and 36 rows,
/// in units of SolveEffort.
inline double cost_of_newton_step(std::size_t rows) {
  constexpr double kOfStep = 0.15, kOfPair = 1.8e-3, kOfTriple = 2.3e-5;
  const auto n = static_cast<double>(rows);
  return kOfStep + kOfPair * n * n + kOfTriple * n * n * n;
}

}  // namespace constraint_sim::engine
