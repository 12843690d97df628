#pragma once

#include <string>
#include <vector>

namespace constraint_sim {

/// A URDF whose links and joints have prefixes, for programs such as robot_state_publisher that
/// know no prefix.
struct PrefixedUrdf {
  std::string text;
  std::vector<std::string> joints;  ///< names with the prefix
};

/// Puts prefixes before the names of links and joints, also in `parent`, `child` and `mimic`. Names
/// elsewhere, as in `<gazebo>`, stay. Names of meshes become URIs, where `folder` is the folder of
/// the URDF, as in mesh_uri().
PrefixedUrdf prefixed_urdf(const std::string& urdf, const std::string& link_prefix,
                           const std::string& joint_prefix, const std::string& folder = "");

}  // namespace constraint_sim
