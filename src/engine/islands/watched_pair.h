#pragma once

#include <utility>

#include "engine/collision/narrowphase.h"

namespace constraint_sim::engine {

/// Two bodies that may touch within the step, and the separation of their shapes at its start.
struct WatchedPair {
  std::pair<int, int> bodies;
  Separation apart;
};

}  // namespace constraint_sim::engine
