#pragma once

#include <cmath>

namespace constraint_sim::engine {

/// The larger of two, and NaN where either is one: std::max() forgets what is not a number, and so
/// does a comparison that only takes it over.
inline double larger(double a, double b) { return a >= b || std::isnan(a) ? a : b; }

}  // namespace constraint_sim::engine
