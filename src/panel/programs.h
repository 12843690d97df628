#pragma once

#include <string>

namespace constraint_sim::panel {

/// Returns the path of a program of the package. It lies beside the panel's library in devel and
/// install spaces; rosrun would search the package and may ask which one to run.
std::string program(const std::string& name);

}  // namespace constraint_sim::panel
