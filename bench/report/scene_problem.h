#pragma once

#include <string>

#include "problem.h"

namespace constraint_sim::report {

/// A scene file as a problem that every engine can build, without a reference. Throws Unsupported
/// naming what a problem cannot express, and engine::SceneError.
Problem problem_from_scene(const std::string& path, double duration, double sample);

}  // namespace constraint_sim::report
