#pragma once

#include "constraint_sim/engine/stop_flag.h"
#include "engine/math/cone_solver.h"
#include "engine/math/list.h"

namespace constraint_sim::engine {

/// Solves cone problems, counts the work of a step in substeps of a group of one point, and ends
/// where the limit of the step is used up or the step has to stop.
class CountedSolver {
 public:
  void begin_step() {
    work_ = 0.0;
    solver_.forget();
  }
  /// `most`: limit for the step.
  void begin_interval(double most, StopFlag stop) {
    most_ = most;
    stop_ = stop;
  }

  void add(double work) { work_ += work; }
  double work() const { return work_; }
  bool is_used_up() const { return work_ > most_; }
  bool is_stopped() const { return is_set(stop_); }
  /// Returns false also where the limit is used up, or the step has to stop.
  bool solve(const ConeProblem& problem, List<double>* solution) {
    SolveEffort effort{most_ - work_, stop_};
    const bool is_found = solver_.solve(problem, solution, &effort);
    work_ += effort.spent;
    return is_found;
  }

 private:
  ConeSolver solver_;
  double most_ = 0.0, work_ = 0.0;
  StopFlag stop_ = nullptr;
};

}  // namespace constraint_sim::engine
