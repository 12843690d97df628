#pragma once

#include "constraint_sim/engine/body.h"
#include "constraint_sim/engine/shape.h"

namespace constraint_sim::engine {

/// The least width of a shape [m]; infinite of planes, which are half-spaces.
double thickness(const Shape& shape);

/// No point of its shape is further from the centre of a body [m]; infinite of planes.
double extent(const Body& body);

}  // namespace constraint_sim::engine
