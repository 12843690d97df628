#pragma once

#include <string>
#include <vector>

#include "constraint_sim/world.h"

namespace constraint_sim::engine {

/// What a world uses, what it leaves out, and why, as YAML text.
std::string explain(const World& world);

/// What a world leaves out, and why: one line each, `what: why`.
std::vector<std::string> left_out(const World& world);

/// What a world has that may not be meant, one line each, beginning with whose it is: a dynamic
/// body whose inertia no distribution of mass has.
std::vector<std::string> warnings(const World& world);

}  // namespace constraint_sim::engine
