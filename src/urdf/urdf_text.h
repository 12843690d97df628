#pragma once

#include <urdf_model/model.h>

#include <string>

namespace constraint_sim {

/// Writes a model as the text of a URDF, for programs that show a robot of another format.
/// Rotations are exact to rounding. Left out are collisions with shapes that URDF lacks.
std::string urdf_text(const urdf::ModelInterface& model);

}  // namespace constraint_sim
