#pragma once

#include <constraint_sim/AddBody.h>
#include <constraint_sim/ApplyEdits.h>

#include <Eigen/Geometry>
#include <cstddef>
#include <string>
#include <vector>

#include "constraint_sim/engine/world.h"
#include "urdf/robot.h"

namespace constraint_sim {

/// Most vertices and triangles of a MESH in a message.
constexpr std::size_t kMostVerticesInMessage = 1000000;
constexpr std::size_t kMostTrianglesInMessage = 1000000;

/// A mesh of a body that markers show by its file.
struct ShownMesh {
  std::string body;
  std::size_t part = 0;       ///< number of the body's shape that is the first hull of the mesh
  Eigen::Isometry3d in_part;  ///< pose of the mesh in the frame of that shape
  urdf::GeometryConstSharedPtr geometry;
};

/// Meshes of the bodies of a request.
struct DividedMeshes {
  std::vector<ShownMesh> shown;
  std::string sentences;  ///< says how each mesh collides; empty: the request has no meshes
};

/// Replaces each MESH, and each HULL with a `mesh_resource`, by hulls with vertices, so that the
/// edit and its replay read no files. A file is divided once for each scale. HACD may take seconds:
/// call outside of the stepping thread. Throws std::invalid_argument that names field and value.
DividedMeshes divide_meshes(AddBodyRequest* request);
DividedMeshes divide_meshes(ApplyEditsRequest* request);
template <class Request>
DividedMeshes divide_meshes(Request*) {
  return {};
}

/// Returns the visuals of meshes whose bodies are in `world`.
std::vector<RobotVisual> visuals_of(const DividedMeshes& meshes, const engine::World& world);

}  // namespace constraint_sim
