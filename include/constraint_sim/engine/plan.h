#pragma once

#include <string>
#include <vector>

#include "constraint_sim/engine/world.h"

namespace constraint_sim::engine {

/// Describes the methods, bodies and features that a world uses, those it leaves out, and why, as
/// YAML text.
std::string explain(const World& world);

/// Lists the features that a world leaves out, one line each, `feature: why`.
std::vector<std::string> left_out(const World& world);

/// Lists settings of a world that may be mistakes, one line each, beginning with the name of the
/// body: a dynamic body whose inertia no distribution of mass has.
std::vector<std::string> doubtful_settings(const World& world);

/// Describes the present error of a joint and how it closes, in words; empty where the joint fits.
std::string text_of_opening(const World& world, JointId id);

}  // namespace constraint_sim::engine
