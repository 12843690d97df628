#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <optional>
#include <vector>

#include "urdf/mesh_file.h"

namespace constraint_sim {

/// Whether the program was built with HACD, which divides meshes into convex parts.
bool divides_meshes();

/// Volume that a closed surface encloses [m³], positive where its triangles are counter-clockwise
/// as seen from outside; nothing where an edge is not between two triangles of equal direction.
std::optional<double> enclosed_volume(const TriangleMesh& mesh);

/// Divides a mesh into at most `most` parts whose convex hulls together are about the mesh, by HACD
/// (Mamou & Ghorbel, IEEE Int. Conf. Image Processing 2009). Hulls fill hollows up to 2 % of the
/// diagonal of the mesh, or more where that takes too many parts. Returns the points of each part;
/// nothing where there is no such division. Of more than 500 triangles HACD gets a copy with points
/// united in cells of a grid, of 1/40 of the diagonal or larger, and a part has all points of its
/// cells; hulls then fill up to a cell more.
std::vector<std::vector<Eigen::Vector3d>> convex_parts(const TriangleMesh& mesh, std::size_t most);

}  // namespace constraint_sim
