#pragma once

#include <Eigen/Geometry>
#include <array>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "constraint_sim/engine/world.h"
#include "urdf/parse.h"

namespace constraint_sim {

/// A link as it lies on its body.
struct RobotLink {
  std::string name;  ///< with the prefix: a frame
  engine::BodyId body;
  Eigen::Isometry3d in_body;
};

/// What a robot looks like, where it is.
struct RobotVisual {
  engine::BodyId body;
  Eigen::Isometry3d in_body;
  urdf::GeometryConstSharedPtr geometry;
  std::optional<std::array<double, 4>> colour;  ///< red, green, blue, opacity, 0 to 1
};

/// What bounds commands to a joint; 0: nothing.
struct JointBounds {
  double effort = 0.0;    ///< [N or N m]
  double velocity = 0.0;  ///< [m/s or rad/s]
};

/// A robot that is in a world.
struct Robot {
  std::string name;              ///< in its URDF
  std::vector<RobotLink> links;  ///< the root first
  std::vector<RobotVisual> visuals;
  std::map<std::string, JointBounds> bounds;     ///< of joints, by their names in the world
  std::vector<std::string> bodies, constraints;  ///< names, in the order of adding
  std::vector<std::string> warnings;             ///< what is not as the URDF has it
};

struct RobotOptions {
  std::string prefix;      ///< before the name of each link and joint
  engine::BodyState pose;  ///< of the root link, world; at rest
  bool fixed = false;      ///< the root does not move
  std::string extra;       ///< YAML beside the URDF, docs/robots.md
  MeshExists mesh_exists;
  std::string
      how_to_expand;  ///< says where xacro is left in the URDF what expands it; may be empty
};

/// A robot that is built and not yet in a world: adding it costs little.
struct BuiltRobot {
  Robot robot;                        ///< with ids of its own
  std::vector<engine::Body> bodies;   ///< the first has id 1, as in an empty world
  std::vector<engine::Joint> joints;  ///< the first has id 0, the same
};

/// Builds the robot that a URDF describes. Throws std::invalid_argument.
BuiltRobot build_robot(const std::string& urdf, const RobotOptions& options);

/// Adds a robot to a world, at a cost that is linear in its size. Throws std::invalid_argument
/// where a name is taken, and then the world is what it was.
Robot add_robot(const BuiltRobot& built, engine::World* world);

/// Builds the robot that a URDF describes and adds it to a world, as the functions above.
Robot add_robot(const std::string& urdf, const RobotOptions& options, engine::World* world);

}  // namespace constraint_sim
