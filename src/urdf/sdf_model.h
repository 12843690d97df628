#pragma once

#include <urdf_model/model.h>

#include <Eigen/Geometry>
#include <limits>
#include <map>
#include <string>
#include <vector>

#include "urdf/extra.h"

namespace constraint_sim {

/// A capsule. Markers and other programs see its cylinder, whose length is that of the capsule
/// without the half spheres.
struct CapsuleGeometry : urdf::Cylinder {};

/// A half-space below the x-y plane of the collision's origin; for links that do not move.
struct PlaneGeometry : urdf::Box {};

/// Axis of a joint of an SDF, with the laws of its coordinate.
struct SdfAxis {
  Eigen::Vector3d direction = Eigen::Vector3d::UnitZ();  ///< in the joint's frame, any length
  double lower = -std::numeric_limits<double>::infinity();
  double upper = std::numeric_limits<double>::infinity();
  double effort = 0.0, velocity = 0.0;  ///< limits; 0: none
  double damping = 0.0, friction = 0.0;
  JointSpring spring;
};

enum class SdfJointKind { kFixed, kHinge, kSlider, kBall, kUniversal, kScrew, kGearbox };

struct SdfJoint {
  std::string name;
  SdfJointKind kind = SdfJointKind::kFixed;
  std::string parent, child;  ///< links; the parent may be `world`
  Eigen::Isometry3d frame;    ///< pose in the frame of the SDF
  std::vector<SdfAxis> axes;
  double ratio = 0.0;          ///< pitch of a screw [m per turn], or ratio of a gearbox
  std::string reference_body;  ///< reference body of a gearbox
};

struct SdfLink {
  urdf::LinkSharedPtr link;      ///< name, inertia, shapes and visuals
  Eigen::Isometry3d pose;        ///< in the frame of the SDF
  std::size_t model = 0;         ///< model at the top that the link belongs to
  bool is_static = false;        ///< whether that model is static
  bool is_self_collide = false;  ///< whether the link collides with others of its model
};

/// Models of an SDF, with all poses in the frame that the models are placed in. Names of links and
/// joints of nested models, and of several models, begin with the name of the model and `/`.
struct SdfModel {
  std::string name;
  std::vector<SdfLink> links;
  std::vector<SdfJoint> joints;
  std::map<std::string, LinkProperties> properties;  ///< by link
  std::vector<std::string> warnings;                 ///< parts that are not carried over
};

/// Returns the major version of libsdformat that the program was built with; 0: none.
int sdformat_version();
inline bool reads_sdf() { return sdformat_version() > 0; }

/// Reads an SDF by libsdformat, which fetches nothing and opens no further files. `folder`:
/// absolute path of the folder of the SDF, where meshes named `model://` are searched; may be
/// empty. Throws std::invalid_argument.
SdfModel read_sdf_model(const std::string& text, const std::string& folder);

}  // namespace constraint_sim
