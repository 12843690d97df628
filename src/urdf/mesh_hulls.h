#pragma once

#include <urdf_model/model.h>

#include <Eigen/Geometry>
#include <map>
#include <string>

#include "constraint_sim/engine/shape.h"
#include "urdf/meshes.h"

namespace constraint_sim {

/// Most vertices of the hull of a mesh; a mesh with more keeps those farthest along as many
/// directions.
constexpr std::size_t kMostMeshVertices = 128;

/// Convex hull of a mesh, centred as bodies have it.
struct MeshHull {
  engine::Hull hull;  ///< no surface: the mesh does not collide
  Eigen::Isometry3d in_mesh = Eigen::Isometry3d::Identity();  ///< pose in the frame of the mesh
  std::string sentence;  ///< says how the mesh collides, or why it does not
};

/// Convex hulls of the collision meshes of a robot. Each file is read once for each scale.
class MeshHulls {
 public:
  explicit MeshHulls(MeshPath path) : path_(std::move(path)) {}

  /// Returns the hull of a mesh whose name is a URI.
  const MeshHull& of(const urdf::Mesh& mesh);

 private:
  MeshPath path_;
  std::map<std::string, MeshHull> found_;  // by name and scale
};

}  // namespace constraint_sim
