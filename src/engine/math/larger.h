#pragma once

#include <cmath>

namespace constraint_sim::engine {

/// Returns the larger of two numbers, and NaN where either is NaN. std::max() may drop a NaN.
inline double larger(double a, double b) { return a >= b || std::isnan(a) ? a : b; }

}  // namespace constraint_sim::engine
