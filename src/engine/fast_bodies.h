#pragma once

#include "constraint_sim/engine/shape.h"

namespace constraint_sim::engine {

/// The least width of a shape [m]; infinite of planes, which are half-spaces.
double thickness(const Shape& shape);

}  // namespace constraint_sim::engine
