#pragma once

namespace constraint_sim::engine {

// Distances and rates that count as zero where events are decided, of coordinates of joints and of
// contacts alike.

inline constexpr double kTouching = 1e-10;  ///< [m or rad] a distance up to this counts as zero
inline constexpr double kResting = 1e-9;    ///< [m/s or rad/s] a rate up to this counts as zero

}  // namespace constraint_sim::engine
