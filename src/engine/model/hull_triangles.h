#pragma once

#include <Eigen/Core>
#include <array>
#include <cstddef>
#include <vector>

namespace constraint_sim::engine {

/// Returns the points that are vertices of their convex hull, in their order, or lie in its surface
/// to rounding. Throws std::invalid_argument as hull_triangles() does, and as soon as a hull of
/// some of the points has more than `most` ≥ 4 vertices: the time does not depend on their number.
std::vector<Eigen::Vector3d> hull_vertices(const std::vector<Eigen::Vector3d>& points,
                                           std::size_t most);

/// Returns the triangles of the convex hull of points, counter-clockwise as seen from outside, by
/// numbers of points. Throws std::invalid_argument if Qhull finds no hull, as of points in a plane.
std::vector<std::array<int, 3>> hull_triangles(const std::vector<Eigen::Vector3d>& points);

}  // namespace constraint_sim::engine
