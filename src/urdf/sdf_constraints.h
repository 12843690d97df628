#pragma once

#include <Eigen/Geometry>
#include <string>
#include <vector>

#include "engine/scene/yaml_element.h"
#include "urdf/sdf_model.h"

namespace constraint_sim {

/// Constraints of a robot from SDF beside the tree, written as the list `constraints` of an extra
/// YAML.
class SdfConstraints {
 public:
  /// An end of a constraint: a link, and the pose of the constraint's frame in the link's frame.
  struct End {
    std::string link;
    Eigen::Isometry3d frame;
  };

  /// Begins a constraint, to which all other functions add.
  void begin(const std::string& name, const char* type);
  /// `side`: `a` or `b`; `has_frame`: whether the kind has axes.
  void add_end(const char* side, const End& end, bool has_frame);
  void add(const char* key, double value);
  void add_coordinates(const std::vector<SdfAxis>& axes);
  void add_joints(const std::string& first, const std::string& second);

  std::vector<engine::YamlElement> take() const;

 private:
  std::string text_;
};

}  // namespace constraint_sim
