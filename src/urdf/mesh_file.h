#pragma once

#include <Eigen/Core>
#include <array>
#include <string>
#include <vector>

namespace constraint_sim {

/// A surface of triangles, counter-clockwise as seen from outside.
struct TriangleMesh {
  using Triangle = std::array<int, 3>;

  std::vector<Eigen::Vector3d> points;  ///< [m], each once
  std::vector<Triangle> triangles;      ///< numbers of points
};

/// Makes points that are equal to one, and leaves out triangles without three different points.
void unite_equal_points(TriangleMesh* mesh);

/// Returns the triangles in a file (STL, DAE, OBJ and others). Transforms of nodes and the unit of
/// the file place them, as in rviz. Throws std::invalid_argument for a file without triangles, of
/// more than 256 MiB or 3 million vertices, or that cannot be read.
TriangleMesh read_mesh(const std::string& path);

}  // namespace constraint_sim
