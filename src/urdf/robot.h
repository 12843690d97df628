#pragma once

#include <Eigen/Geometry>
#include <array>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "constraint_sim/engine/world.h"
#include "urdf/meshes.h"
#include "urdf/parse.h"

namespace constraint_sim {

/// Pose of a link in its body.
struct RobotLink {
  std::string name;  ///< name with the prefix; also the frame's name
  engine::BodyId body;
  Eigen::Isometry3d in_body;
};

/// Visual of a link.
struct RobotVisual {
  engine::BodyId body;
  Eigen::Isometry3d in_body;
  urdf::GeometryConstSharedPtr geometry;
  std::optional<std::array<double, 4>> colour;  ///< red, green, blue, opacity, 0 to 1
};

/// Bounds of commands to a joint; 0: unbounded.
struct JointBounds {
  double effort = 0.0;    ///< [N or N m]
  double velocity = 0.0;  ///< [m/s or rad/s]
};

/// A robot in a world.
struct Robot {
  std::string name;              ///< in its URDF
  std::vector<RobotLink> links;  ///< root first
  std::vector<RobotVisual> visuals;
  std::map<std::string, JointBounds> bounds;  ///< by the joint's name in the world
  /// Joints that are fixed since they move no mass, and their positions [m or rad]; names as in the
  /// URDF.
  std::map<std::string, double> fixed_joints;
  std::vector<std::string> bodies, constraints;  ///< names, in the order of adding
  std::vector<std::string> warnings;             ///< deviations from the URDF
};

struct RobotOptions {
  std::string prefix;      ///< prefix of the names of links and joints
  engine::BodyState pose;  ///< pose of the root link in the world's frame, at rest
  bool fixed = false;      ///< the root does not move
  std::string extra;       ///< YAML beside the URDF, docs/robots.md
  std::string srdf;        ///< SRDF whose `disable_collisions` are read; may be empty
  std::string folder;  ///< absolute path where relative names of meshes start; empty: there is none
  MeshExists mesh_exists;
  MeshPath mesh_path;         ///< finds the files of collision meshes
  std::string how_to_expand;  ///< command that expands xacro, for error messages; may be empty
};

/// A robot that is built but not yet in a world: adding it is cheap.
struct BuiltRobot {
  Robot robot;                        ///< with ids of its own
  std::vector<engine::Body> bodies;   ///< the first body has id 1, as in an empty world
  std::vector<engine::Joint> joints;  ///< the first joint has id 0, as in an empty world
  std::string urdf;  ///< URDF of a robot that was given in another format; empty: given as URDF
};

/// Builds the robot of a URDF, or of an SDF. Throws std::invalid_argument.
BuiltRobot build_robot(const std::string& text, const RobotOptions& options);

/// Adds a robot to a world, at a cost linear in its size. Throws std::invalid_argument where a name
/// is taken, and leaves the world unchanged.
Robot add_robot(const BuiltRobot& built, engine::World* world);

/// Builds the robot of a URDF, or of an SDF, and adds it to a world. Throws std::invalid_argument.
Robot add_robot(const std::string& text, const RobotOptions& options, engine::World* world);

}  // namespace constraint_sim
