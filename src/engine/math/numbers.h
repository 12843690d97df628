#pragma once

#include <limits>

namespace constraint_sim::engine {

inline constexpr double kPi = 3.14159265358979323846;
inline constexpr double kInfinity = std::numeric_limits<double>::infinity();
/// Distance from 1 to the next larger double, 2⁻⁵².
inline constexpr double kEpsilon = std::numeric_limits<double>::epsilon();

}  // namespace constraint_sim::engine
