#pragma once

#include <cmath>

#include "support.h"

namespace constraint_sim::engine {

/// Height above a floor or a stop at t, of a fall from h with bounces; 0 once at rest.
inline double bouncing(double h, double e, double t) {
  double fall = std::sqrt(2.0 * h / kGravity), v = kGravity * fall;
  if (t < fall) return h - 0.5 * kGravity * t * t;
  t -= fall;
  for (int i = 0; i < 10000; ++i) {
    v *= e;
    if (v < 1e-7) return 0.0;
    const double flight = 2.0 * v / kGravity;
    if (t < flight) return v * t - 0.5 * kGravity * t * t;
    t -= flight;
  }
  return 0.0;
}

}  // namespace constraint_sim::engine
