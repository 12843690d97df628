#pragma once

#include <nlohmann/json.hpp>

#include "constraint_sim/engine/verify.h"

namespace constraint_sim::engine {

/// Returns `verify` of the runner's JSON report; null for missing figures.
nlohmann::json json_of(const VerifyReport& verified);

}  // namespace constraint_sim::engine
