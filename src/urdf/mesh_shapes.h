#pragma once

#include <urdf_model/model.h>

#include <Eigen/Geometry>
#include <cstddef>
#include <map>
#include <string>
#include <utility>
#include <vector>

#include "constraint_sim/engine/shape.h"
#include "urdf/mesh_file.h"
#include "urdf/meshes.h"

namespace constraint_sim {

/// Most vertices of the hull of a mesh or of a part; where there are more, those stay that are
/// farthest along directions and beyond the hull of the others.
constexpr std::size_t kMostMeshVertices = 128;

/// Most convex parts of a mesh.
constexpr std::size_t kMostMeshParts = 16;

/// A convex hull, centred as bodies have it.
struct MeshHull {
  engine::Hull hull;
  Eigen::Isometry3d in_mesh = Eigen::Isometry3d::Identity();  ///< pose in the frame of the mesh
};

/// How a mesh collides.
struct MeshShape {
  std::vector<MeshHull> hulls;  ///< none: the mesh does not collide
  std::string sentence;         ///< says how the mesh collides, or why it does not
};

/// Returns how a surface of triangles collides: as at most `most_parts` convex parts. Throws
/// std::invalid_argument for points in a plane.
MeshShape collision_of(const TriangleMesh& mesh, std::size_t most_parts);

/// Returns the mesh in a file, scaled along its axes; a negative scale mirrors it. Throws as
/// read_mesh().
TriangleMesh read_scaled_mesh(const std::string& path, const Eigen::Vector3d& scale);

/// Shapes of the collision meshes of a robot. Each file is read once for each scale and number of
/// parts.
class MeshShapes {
 public:
  /// `most_parts`: greatest number of convex parts of each mesh of a link, 1 to kMostMeshParts;
  /// kMostMeshParts for links that it does not have.
  MeshShapes(MeshPath path, std::map<std::string, std::size_t> most_parts)
      : path_(std::move(path)), most_parts_(std::move(most_parts)) {}

  /// Returns the shape of a mesh of a link; the name of the mesh is a URI.
  const MeshShape& of(const std::string& link, const urdf::Mesh& mesh);

 private:
  MeshPath path_;
  std::map<std::string, std::size_t> most_parts_;
  std::map<std::string, MeshShape> found_;  // by name, scale and number of parts
};

}  // namespace constraint_sim
