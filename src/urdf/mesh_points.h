#pragma once

#include <Eigen/Core>
#include <string>
#include <vector>

namespace constraint_sim {

/// Whether the program was built with assimp, which reads meshes.
bool reads_meshes();

/// Returns the vertices of all triangles in a file (STL, DAE, OBJ and others) [m]. Transforms of
/// nodes and the unit of the file place them, as in rviz. Throws std::invalid_argument for a file
/// without triangles, with more than 3 million vertices, or that cannot be read.
std::vector<Eigen::Vector3d> read_mesh_points(const std::string& path);

}  // namespace constraint_sim
