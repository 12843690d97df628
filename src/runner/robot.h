#pragma once

#include <string>
#include <vector>

#include "constraint_sim/engine/world.h"

namespace constraint_sim::engine {

/// How the robot of a URDF is put into an empty world.
struct RobotArguments {
  std::string extra;  ///< path of the YAML; empty: the file beside the URDF, if there is one
  bool fixed = false;
  double z = 0.0;  ///< height of the root link [m]
};

/// Returns whether a text begins as XML, as a URDF does and a scene does not.
bool is_xml(const std::string& text);

/// Returns the files beside a URDF that load_robot() reads as well.
std::vector<std::string> files_beside(const std::string& urdf, const RobotArguments& arguments);

/// Returns a world with the robot of a URDF alone, and prints what deviates from the URDF to
/// standard error. `path` is empty where the text is from standard input. Throws
/// std::invalid_argument where the robot is rejected, and where this program has no reader of
/// URDFs.
World load_robot(const std::string& text, const std::string& path, const RobotArguments& arguments);

}  // namespace constraint_sim::engine
