#pragma once

#include <constraint_sim/Body.h>
#include <constraint_sim/Shape.h>

#include "constraint_sim/engine/body.h"

namespace constraint_sim {

/// Reads the type and the dimensions of a shape. Throws std::invalid_argument for types that do not
/// exist, and for fields that the type does not have.
engine::Shape from_msg(const Shape& shape);
/// Rejects a friction or restitution of a shape without `has_surface`.
void check_surface(const Shape& shape);
/// Reads a body with its shapes. Throws std::invalid_argument that names field and value.
engine::Body from_msg(const Body& body);

}  // namespace constraint_sim
