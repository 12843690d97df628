#pragma once

#include <nlohmann/json.hpp>
#include <string>

#include "constraint_sim/engine/world.h"

namespace constraint_sim::engine {

// Constraints in the runner's output files. Coordinates count whole turns; a distance constraint
// has its length instead. Force [N] and torque [N m] come from World::joint_wrench().

std::string constraint_csv_header();
/// Returns a row for each constraint.
std::string constraint_csv_rows(const World& world);

/// Returns the present state of the constraints, by name.
nlohmann::json constraints_of(const World& world);

}  // namespace constraint_sim::engine
