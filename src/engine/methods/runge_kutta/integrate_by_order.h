#pragma once

#include "engine/dynamics/integrator_options.h"
#include "engine/math/embedded_pairs.h"
#include "engine/math/integrate.h"

namespace constraint_sim::engine {

/// Integrates an interval of length h from t [s] by the pair of the order in `options`. `step`:
/// first guess of a substep; 0: h [s].
template <class System>
IntegrationResult integrate(System& system, const StageMemory& memory, double t, double h,
                            const IntegratorOptions& options, StopFlag stop, double& step) {
  if (step == 0.0) step = h;
  return options.order == 5 ? integrate<DormandPrince5>(system, memory, t, h, options.tolerance,
                                                        step, options.most_attempts, stop)
                            : integrate<DormandPrince8>(system, memory, t, h, options.tolerance,
                                                        step, options.most_attempts, stop);
}

/// Takes a substep by the pair of the order in `options`; by order 3 or 1 tries one.
template <class System>
bool take_substep_by_order(System& system, const StageMemory& memory,
                           const IntegratorOptions& options, StopFlag stop, RemainingInterval* left,
                           double* step, IntegrationResult* progress) {
  const SubstepLimits limits{options.tolerance, options.most_attempts, stop, options.order <= 3};
  const auto take = [&](auto pair) {
    return take_substep<decltype(pair)>(system, memory, limits, *left, *step, *progress);
  };
  return options.order == 1   ? take(Euler{})
         : options.order == 3 ? take(Kutta3{})
         : options.order == 5 ? take(DormandPrince5{})
                              : take(DormandPrince8{});
}

}  // namespace constraint_sim::engine
