#pragma once

#include <map>
#include <optional>
#include <string>
#include <vector>

#include "engine/scene/yaml_element.h"

namespace constraint_sim {

/// What a link has that a URDF has no word for.
struct LinkProperties {
  double friction = 0.0;
  double restitution = 0.0;
  bool no_collision = false;
};

/// The YAML beside a URDF (docs/robots.md). Names are those of the URDF, without prefix.
struct RobotExtra {
  std::map<std::string, double> positions;            ///< of joints at first [m or rad]
  std::map<std::string, engine::YamlElement> motors;  ///< of joints
  std::map<std::string, LinkProperties> links;
  std::vector<engine::YamlElement> constraints;  ///< as in scenes, of links
};

/// Throws engine::SceneError. Whether there are such joints and links is not looked up.
RobotExtra read_extra(const std::string& text);

}  // namespace constraint_sim
