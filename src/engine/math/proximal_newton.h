#pragma once

#include "constraint_sim/engine/stop_flag.h"
#include "engine/math/list.h"
#include "engine/math/proximal_equations.h"

namespace constraint_sim::engine {

/// Solves ProximalEquations by proximal steps (Rockafellar, SIAM J. Control Optim. 14 (1976) 877),
/// each by Newton's method with a line search. The larger σ, the nearer is x to a solution, and the
/// smaller is the set of starts from which Newton's method converges: σ grows after steps that were
/// easy, and falls after steps that failed. Shifts are held where the equations can; a step that
/// failed is then first tried again with shifts that are not held, or the reverse.
class ProximalNewton {
 public:
  struct Goal {
    double residual;  ///< at which the steps end, as a rate
    int most_steps;   ///< most steps of Newton's method
    double sigma;     ///< σ of the first step
  };

  /// Improves `p`, whose residual is `residual`, until the goal is reached; returns the residual.
  double solve(const Goal& goal, double residual, StopFlag stop, ProximalEquations* equations,
               List<double>* p);
  /// Number of steps of Newton's method in the last solution.
  int steps() const { return steps_; }

 private:
  /// How a proximal step ends; kEasy after few iterations.
  enum class End { kSolved, kEasy, kHard, kFailed };

  void iterate(const Goal& goal, StopFlag stop, ProximalEquations* equations);
  End step(const Goal& goal, double sigma, StopFlag stop, ProximalEquations* equations);
  void consider(ProximalEquations* equations);

  int steps_ = 0;
  bool is_held_ = false;   // shifts
  double residual_ = 0.0;  // least of all iterates
};

}  // namespace constraint_sim::engine
