#pragma once

#include <cstddef>

#include "constraint_sim/engine/stop_flag.h"
#include "engine/math/body_cone_problem.h"
#include "engine/math/cone_problem.h"
#include "engine/math/list.h"

namespace constraint_sim::engine {

/// Solves a BodyConeProblem of few rows by Newton's method with the dense matrix A, which converges
/// where the alternating directions of BodyConeSolver do so slowly.
class SmallConeSolver {
 public:
  static constexpr std::size_t kMostRows = 60;

  /// Replaces the impulses p by what ConeSolver finds from them. Its answer may be worse.
  void solve(const BodyConeProblem& problem, StopFlag stop, List<double>* p);

 private:
  void set(const BodyConeProblem& problem, const List<double>& p);

  ConeSolver solver_;
  ConeProblem dense_;
  List<std::size_t> order_;                  // rows of the problem: contacts, then single rows
  List<BodyConeProblem::Twist> velocities_;  // effect on each body of a unit impulse of a row
  List<double> p_;                           // impulses in the order of order_
};

}  // namespace constraint_sim::engine
