#pragma once

#include "engine/collision/narrowphase.h"
#include "engine/model/shape_pair.h"

namespace constraint_sim::engine {

/// Two shapes that may touch within the step, and their separation at its start.
struct WatchedPair {
  ShapePair shapes;
  Separation apart;
};

}  // namespace constraint_sim::engine
