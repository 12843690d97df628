#pragma once

#include <string>

namespace constraint_sim {

/// Throws std::invalid_argument for MJCF and for parts of an SDF, by the root element, and for a
/// text without elements of XML.
void check_root_element(const std::string& urdf);

/// Returns the elements of a URDF or an SDF that the conversion does not read, such as
/// `<gazebo> (3, first in line 12)`: the first ten kinds, and how many more. Empty: none. Not
/// listed are xacro's elements and the contents of unread elements.
std::string unread_elements(const std::string& urdf);

}  // namespace constraint_sim
