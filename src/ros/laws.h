#pragma once

#include <constraint_sim/Constraint.h>

#include <string>
#include <vector>

#include "constraint_sim/engine/joint.h"

namespace constraint_sim {

/// Reads the laws of the joint's coordinates: the first coordinate from the fields of the message
/// and from plain keys, further ones from keys that begin with `1/` or `2/`. Throws
/// std::invalid_argument naming the invalid key or field.
void read_laws(const Constraint& msg, engine::Joint* joint);

/// Returns a setting that is 0 or 1. Throws std::invalid_argument naming `field` for other values.
bool flag(double value, const char* field);

/// Changes properties of an existing joint, by key: laws as in read_laws() with the message's
/// fields as keys, `motor` 0 to remove a motor, lengths and springs, break forces, `enabled`.
/// Throws std::invalid_argument naming the invalid key.
void change_properties(const std::vector<std::string>& keys, const std::vector<double>& values,
                       engine::Joint* joint);

}  // namespace constraint_sim
