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
  double volume = 1.0;        ///< of a convex part of a mesh [m³]; 1 for others, which stand alone
};

/// Returns the name of the empty link that converted formats put in the frame of a joint. Where it
/// is the first link of a lump, the lump has the name of the second.
inline std::string joint_frame_link(const std::string& joint) { return joint + "/frame"; }

/// Links that fixed joints unite to one body. The lump's frame is that of its first link.
struct Lump {
  std::string link;                 ///< name of the first link that is no joint_frame_link()
  urdf::JointConstSharedPtr joint;  ///< joint to the parent lump; none for the root
  std::vector<std::string> links;   ///< all links, depth first
  /// Index of the first lump that fixed joints connect to this one; its own index without such.
  std::size_t group = 0;
  double mass = 0.0;                                        ///< [kg]
  Eigen::Vector3d first_moment = Eigen::Vector3d::Zero();   ///< ∫ r dm [kg m]
  Eigen::Matrix3d second_moment = Eigen::Matrix3d::Zero();  ///< inertia about the origin [kg m²]
  std::optional<LumpShape> shape;
  std::vector<LumpShape> more_shapes;  ///< further shapes, which need bodies of their own
  std::optional<std::size_t> part_of;  ///< lump that this one carries a further shape of

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

/// Lumps links connected by fixed joints. A body has one shape; so a link with a mass and a shape,
/// below a parent that has a shape, becomes a separate welded body. Throws std::invalid_argument
/// for invalid masses and dimensions.
Lumps lump_links(const urdf::ModelInterface& model, MeshShapes* meshes);

/// Most bodies of a robot that carry further shapes; each costs a weld in each step.
constexpr std::size_t kMostParts = 100;

/// Makes a lump for each further shape, behind all others. A lump and its parts get equal shares of
/// its mass and inertia, with the same centre of mass, so welded together they move as it did.
void split_shapes(Lumps* lumps);

}  // namespace constraint_sim
