#pragma once

#include "engine/math/numbers.h"

namespace constraint_sim::engine {

/// Integration rule of implicit steps.
enum class ImplicitMode {
  kOrder2,  ///< midpoint rule
  kOrder4,  ///< composition of midpoint steps; order 2 with dampers, which allow no negative steps
  kDissipate,  ///< BDF2
};

/// Settings of an integration, and limits beyond which it gives up.
struct IntegratorOptions {
  int order;         ///< 8 or 5, of explicit steps; also 3, of a single substep
  double tolerance;  ///< local error per second [m]; 0: one substep per interval
  ImplicitMode mode = ImplicitMode::kOrder4;
  /// Frequency of bodies under joint forces beyond which the island counts as stiff [rad/s].
  double most_frequency = kInfinity;
  /// Largest share of the kinetic energy that the start may remove.
  double most_projected = kInfinity;
  /// Substeps beyond which the method gives up, rejected substeps included.
  int most_attempts = 50000;
  /// Substeps and events of an interval beyond which event-driven integration gives up.
  double most_work = kInfinity;
  int most_halvings = 9;  ///< halvings of an interval by implicit steps
};

}  // namespace constraint_sim::engine
