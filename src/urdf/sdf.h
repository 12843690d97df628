#pragma once

#include <urdf_model/model.h>
#include <urdf_world/types.h>

#include <string>
#include <vector>

#include "constraint_sim/engine/body.h"
#include "urdf/extra.h"
#include "urdf/sdf_model.h"

namespace constraint_sim {

/// Robot of an SDF as the tree of a URDF, with the parts beside the tree as of an extra YAML.
struct SdfRobot {
  urdf::ModelInterfaceSharedPtr model;
  RobotExtra extra;        ///< constraints, springs, frictions and pairs that do not collide
  engine::BodyState pose;  ///< pose of the root link
  bool is_fixed = false;   ///< whether the root does not move
  std::vector<std::string> warnings;
};

/// Converts an SDF. The first joint to a link in the order of the text is its joint in the tree;
/// further joints to the link close loops and become constraints, as do joints of kinds that URDF
/// lacks. Several links without such a joint, and joints to the world, get a root `world` that does
/// not move. `pose` is that of the frame of the SDF; `is_fixed`: links without a joint do not move.
/// Throws std::invalid_argument.
SdfRobot robot_of_sdf(const SdfModel& given, const engine::BodyState& pose, bool is_fixed);

/// Adds the parts of an SDF to an extra YAML, which has precedence for properties of links.
void add_sdf_extra(const RobotExtra& sdf, RobotExtra* extra);

}  // namespace constraint_sim
