#pragma once

#include "engine/dynamics/redundant_rows.h"

namespace constraint_sim::engine {

/// Joints being closed depend on each other only up to this multiple of their opening angle.
inline constexpr double kOpenShare = 30.0;

/// Whether any joint is being closed.
bool is_closing(const IntervalInputs& inputs);
/// Largest opening of a joint being closed, as an angle [rad]. Motors on their way to a position
/// leave the other rows met, so the dependence among those is known to rounding.
double opening(const PlacedRows& rows, bool with_motors);
/// Largest min(kOpenShare e²/L, e) of the joints being closed, opened by e with arm L [m]. Until
/// they are closed, joints that fit in the end may contradict each other by part of it.
double closing_curvature(const PlacedRows& rows);

}  // namespace constraint_sim::engine
