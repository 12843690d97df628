#pragma once

#include <urdf_model/model.h>

#include <cstddef>
#include <map>
#include <optional>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "engine/scene/yaml_element.h"
#include "urdf/mesh_shapes.h"

namespace constraint_sim {

/// Properties of a link that URDF cannot express.
struct LinkProperties {
  double friction = 0.0;
  double restitution = 0.0;
  bool no_collision = false;
  std::size_t convex_parts = kMostMeshParts;  ///< most of each collision mesh
};

/// Spring of a joint, which an SDF may have.
struct JointSpring {
  double stiffness = 0.0;  ///< [N/m or N m/rad]
  double rest = 0.0;       ///< position where the spring has no force [m or rad]
};

/// Extra YAML beside a URDF (docs/robots.md). Names are those of the URDF, without prefix.
struct RobotExtra {
  std::map<std::string, double> positions;            ///< initial positions of joints [m or rad]
  std::map<std::string, engine::YamlElement> motors;  ///< by joint
  std::map<std::string, JointSpring> springs;         ///< by joint; of an SDF, not of the YAML
  std::set<std::string> static_links;         ///< links that do not move beside the root; of an SDF
  std::map<std::string, std::size_t> models;  ///< model of each link; of an SDF with several models
  double gravity_compensation = 0.0;          ///< as engine::Body has it, for all links
  bool hold = false;  ///< joints with an effort, and without a motor, hold their positions
  std::map<std::string, LinkProperties> links;
  std::vector<engine::YamlElement> constraints;  ///< constraints between links, as in scenes
  std::vector<std::pair<std::string, std::string>> no_contact;  ///< links that do not collide
};

/// Returns the greatest number of convex parts of each collision mesh, by link.
std::map<std::string, std::size_t> most_parts(const RobotExtra& extra);

/// Reads the YAML; does not check whether joints and links exist. Throws engine::SceneError.
RobotExtra read_extra(const std::string& text);

/// Throws std::invalid_argument that names a joint or a link that the URDF does not have.
/// Constraints are not checked.
void check_extra(const RobotExtra& extra, const urdf::ModelInterface& model);

}  // namespace constraint_sim
