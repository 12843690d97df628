#pragma once

#include <urdf_model/model.h>

#include <Eigen/Geometry>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "constraint_sim/engine/body.h"

namespace constraint_sim {

/// A collision geometry that the engine has a shape for.
struct LumpShape {
  engine::Shape shape;
  Eigen::Isometry3d in_lump;
};

/// Links that fixed joints make one body. Its frame is that of its first link.
struct Lump {
  std::string link;                                         ///< the first one
  urdf::JointConstSharedPtr joint;                          ///< that it hangs on; none of the root
  std::vector<std::string> links;                           ///< all, depth first
  double mass = 0.0;                                        ///< [kg]
  Eigen::Vector3d first_moment = Eigen::Vector3d::Zero();   ///< ∫ r dm [kg m]
  Eigen::Matrix3d second_moment = Eigen::Matrix3d::Zero();  ///< inertia about the origin [kg m²]
  std::optional<LumpShape> shape;

  Eigen::Vector3d centre_of_mass() const { return first_moment / mass; }
  /// About the centre of mass, along the axes of the lump [kg m²].
  Eigen::Matrix3d inertia() const;
};

/// Where a link is.
struct LinkPlace {
  std::size_t lump = 0;
  Eigen::Isometry3d in_lump = Eigen::Isometry3d::Identity();
};

struct Lumps {
  std::vector<Lump> list;  ///< parents first
  std::map<std::string, LinkPlace> places;
  std::vector<std::string> warnings;  ///< collisions that are not as described
};

/// Lumps links on fixed joints, but for one that has mass and a shape of its own where its parent
/// has a shape already: a body has one shape, so that link is a body that is welded on. Throws
/// std::invalid_argument for masses and dimensions that cannot be.
Lumps lump_links(const urdf::ModelInterface& model);

}  // namespace constraint_sim
