#pragma once

#include <string>

namespace constraint_sim::panel {

/// The path of a program of the package. It lies beside the library of the panel, in devel and in
/// install space: rosrun would search the package for it, and may ask which one is meant.
std::string program(const std::string& name);

}  // namespace constraint_sim::panel
