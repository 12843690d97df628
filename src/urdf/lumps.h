#pragma once

#include <urdf_model/model.h>

#include <Eigen/Geometry>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "constraint_sim/engine/body.h"
#include "urdf/mesh_shapes.h"

namespace constraint_sim {

/// Returns the inertia of a point of unit mass about the origin [m²].
Eigen::Matrix3d point_inertia(const Eigen::Vector3d& r);

/// Collision geometry as a shape of the engine.
struct LumpShape {
  engine::Shape shape;
  Eigen::Isometry3d in_lump;
  std::string link;           ///< link that the shape belongs to
  std::size_t collision = 0;  ///< number of the link's collision; convex parts of a mesh share it
  double volume = 1.0;        ///< volume of a convex part of a mesh [m³]; 1: another shape
};

/// Returns the name of the empty link that converted formats put in the frame of a joint. Where it
/// is the first link of a lump, the lump has the name of the second.
inline std::string joint_frame_link(const std::string& joint) { return joint + "/frame"; }

/// Links that fixed joints unite to one body. The lump's frame is that of its first link.
struct Lump {
  std::string link;                 ///< name of the first link that is no joint_frame_link()
  urdf::JointConstSharedPtr joint;  ///< joint to the parent lump; none for the root
  std::vector<std::string> links;   ///< all links, depth first
  double mass = 0.0;                ///< [kg]
  Eigen::Vector3d first_moment = Eigen::Vector3d::Zero();   ///< ∫ r dm [kg m]
  Eigen::Matrix3d second_moment = Eigen::Matrix3d::Zero();  ///< inertia about the origin [kg m²]
  std::vector<LumpShape> shapes;
  /// Lump that this one has a plane of, where a static body has planes beside other shapes.
  std::optional<std::size_t> plane_of;

  Eigen::Vector3d centre_of_mass() const { return first_moment / mass; }
  /// Inertia about the centre of mass, in the axes of the lump [kg m²].
  Eigen::Matrix3d inertia() const;
};

/// Pose of a link in its lump.
struct LinkPlace {
  std::size_t lump = 0;
  Eigen::Isometry3d in_lump = Eigen::Isometry3d::Identity();
};

struct Lumps {
  std::vector<Lump> list;  ///< parents first
  std::map<std::string, LinkPlace> places;
  std::vector<std::string> warnings;  ///< collisions that deviate from the URDF
};

/// Lumps links connected by fixed joints. Throws std::invalid_argument for invalid masses and
/// dimensions, and for more shapes than a body has.
Lumps lump_links(const urdf::ModelInterface& model, MeshShapes* meshes);

/// Makes a lump for each plane that is not the only shape of its lump, behind all others: a plane
/// is no part of a compound.
void split_planes(Lumps* lumps);

}  // namespace constraint_sim
