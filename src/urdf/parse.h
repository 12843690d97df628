#pragma once

#include <urdf_model/model.h>
#include <urdf_world/types.h>

#include <Eigen/Geometry>
#include <functional>
#include <string>

namespace constraint_sim {

/// Whether the file that a mesh's name stands for can be read. Empty: not looked for.
using MeshExists = std::function<bool(const std::string& name)>;

/// A robot's description that is a tree of links. Throws std::invalid_argument in plain words for
/// what is no URDF, for a link with two parents or in a cycle, for a mesh that is not there, for
/// elements nested more than 64 deep, and for more than 10 000 links.
urdf::ModelInterfaceSharedPtr parse_urdf(const std::string& text, const MeshExists& mesh_exists);

/// Throws std::invalid_argument that says the URDF is refused, and why.
[[noreturn]] void refuse(const std::string& why);

/// As Eigen has it.
Eigen::Isometry3d to_isometry(const urdf::Pose& pose);
Eigen::Vector3d to_eigen(const urdf::Vector3& vector);

}  // namespace constraint_sim
