#pragma once

#include <string>

#include "problem.h"

namespace constraint_sim::report {

/// Reads a scene file as a problem that every engine can build, without a reference. Throws
/// Unsupported naming the unsupported element, and engine::SceneError.
Problem problem_from_scene(const std::string& path, double duration, double sample);

}  // namespace constraint_sim::report
