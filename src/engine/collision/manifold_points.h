#pragma once

#include <limits>

#include "constraint_sim/engine/body.h"
#include "constraint_sim/engine/contact.h"

namespace constraint_sim::engine {

/// Smallest square of a length [m²] that has a reliable direction.
inline constexpr double kSmallestSquare = std::numeric_limits<double>::min();

/// Returns the normal N of a plane: the z axis of its body. The solid half-space is N·x ≤ N·p.
inline Eigen::Vector3d normal_of_plane(const BodyState& plane) {
  return plane.orientation * Eigen::Vector3d::UnitZ();
}

/// Adds a point where its gap is less than the margin. Two boxes share at most eight points; more
/// could come from rounding alone.
inline void add_point(Manifold& manifold, const Eigen::Vector3d& position, double depth,
                      std::uint32_t feature, double margin) {
  if (!(depth > -margin) || manifold.count == static_cast<int>(manifold.points.size())) return;
  manifold.points[manifold.count++] = {position, depth, feature};
}

/// Exchanges both shapes of a manifold.
inline void exchange_shapes(Manifold* manifold) {
  for (int i = 0; i < manifold->count; ++i) {
    manifold->points[i].position -= manifold->points[i].depth * manifold->normal;
  }
  manifold->normal = -manifold->normal;
}

}  // namespace constraint_sim::engine
