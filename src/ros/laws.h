#pragma once

#include <string>
#include <vector>

#include "constraint_sim/engine/joint.h"

namespace constraint_sim {

/// Changes properties of an existing joint, by key: laws of coordinates, further coordinates by
/// keys that begin with `1/` or `2/`, `motor` 0 to remove a motor, lengths, break forces,
/// `enabled`. Throws std::invalid_argument naming the invalid key.
void change_properties(const std::vector<std::string>& keys, const std::vector<double>& values,
                       engine::Joint* joint);

}  // namespace constraint_sim
