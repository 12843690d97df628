#pragma once

#include <urdf_model/model.h>
#include <urdf_world/types.h>

#include <Eigen/Geometry>
#include <functional>
#include <string>

namespace constraint_sim {

/// Parses a robot description that is a tree of links. Throws std::invalid_argument for a text that
/// is no URDF, a link with two parents or in a cycle, elements nested more than 64 deep, and more
/// than 10 000 links.
urdf::ModelInterfaceSharedPtr parse_urdf(const std::string& text);

/// Calls a parser that logs to console_bridge, and returns the errors that it logs. One call at a
/// time: the log is global.
std::string errors_logged_by(const std::function<void()>& parser);

/// Throws std::invalid_argument that says the URDF is refused, and why.
[[noreturn]] void refuse(const std::string& why);

/// As Eigen has it.
Eigen::Isometry3d to_isometry(const urdf::Pose& pose);
Eigen::Vector3d to_eigen(const urdf::Vector3& vector);

}  // namespace constraint_sim
