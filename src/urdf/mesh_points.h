#pragma once

#include <Eigen/Core>
#include <string>
#include <vector>

namespace constraint_sim {

/// Whether the program was built with assimp, which reads meshes.
bool reads_meshes();

/// Returns the vertices of all triangles in a file (STL, DAE, OBJ and others) with all transforms
/// of its nodes and its unit [m], as rviz places them. Throws std::invalid_argument for a file that
/// cannot be read, that has no triangles, or that has more than 3 million vertices.
std::vector<Eigen::Vector3d> read_mesh_points(const std::string& path);

}  // namespace constraint_sim
