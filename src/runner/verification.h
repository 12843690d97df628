#pragma once

#include <nlohmann/json.hpp>

#include "constraint_sim/engine/verify.h"

namespace constraint_sim::engine {

/// `verify` in the runner's JSON report; null for what was left out.
nlohmann::json json_of(const VerifyReport& verified);

}  // namespace constraint_sim::engine
