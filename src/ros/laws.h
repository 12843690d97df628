#pragma once

#include <constraint_sim/Constraint.h>

#include <string>
#include <vector>

#include "constraint_sim/engine/joint.h"

namespace constraint_sim {

/// Reads laws of the joint's coordinates: those of the first from the fields of the message and
/// from its keys, those of further ones from keys that begin with `1/` or `2/`. Throws
/// std::invalid_argument naming the key or field that cannot be.
void read_laws(const Constraint& msg, engine::Joint* joint);

/// Sets properties of a joint that acts, by key: laws as above with the message's fields as keys, a
/// motor taken away by `motor` 0, lengths and springs, what it breaks at, `enabled`. Throws
/// std::invalid_argument naming the key that cannot be.
void change_properties(const std::vector<std::string>& keys, const std::vector<double>& values,
                       engine::Joint* joint);

}  // namespace constraint_sim
