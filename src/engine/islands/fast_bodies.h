#pragma once

#include "constraint_sim/engine/body.h"
#include "constraint_sim/engine/shape.h"

namespace constraint_sim::engine {

/// The least width of a shape [m]; infinite of planes, which are half-spaces.
double thickness(const Shape& shape);

/// Of the smaller thickness, that two bodies may move by in a step and not be fast.
inline constexpr double kFastShare = 0.25;

/// How far from the centre of a body its rotation moves its shape [m]; of a plane, which is met so
/// far away.
double reach_of(const Body& body, double distance = 0.0);

/// No point of its shape is further from the centre of a body [m]; infinite of planes.
double extent(const Body& body);

}  // namespace constraint_sim::engine
