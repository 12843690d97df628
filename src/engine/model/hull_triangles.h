#pragma once

#include <Eigen/Core>
#include <array>
#include <vector>

namespace constraint_sim::engine {

/// Returns the triangles of the convex hull of points, counter-clockwise as seen from outside, by
/// numbers of points. Throws std::invalid_argument if Qhull finds no hull, as of points in a plane.
std::vector<std::array<int, 3>> hull_triangles(const std::vector<Eigen::Vector3d>& points);

}  // namespace constraint_sim::engine
