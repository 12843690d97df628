#pragma once

#include <nlohmann/json.hpp>
#include <string>

#include "constraint_sim/engine/world.h"

namespace constraint_sim::engine {

// Constraints in the runner's files. Coordinates count whole turns; of a distance constraint the
// length stands in their place. Force [N] and torque [N m] are those of World::joint_wrench().

std::string constraint_csv_header();
/// A row each constraint.
std::string constraint_csv_rows(const World& world);

/// The constraints now, by name.
nlohmann::json constraints_of(const World& world);

}  // namespace constraint_sim::engine
