#pragma once

#include "engine/support/files.h"
#include "engine/support/paths.h"

namespace constraint_sim {

// Names for the node's own code, which is outside the engine's namespace.
using engine::kMostBytes;
using engine::path_below;
using engine::read_file;
using engine::write_file;

}  // namespace constraint_sim
