#pragma once

#include <Eigen/Core>

#include "constraint_sim/engine/id.h"

namespace constraint_sim::engine {

class World;

/// Closest points of two bodies, world frame: p_a − p_b = distance · normal, to 1e-9 of the size of
/// the larger body. Where a cylinder overlaps another shape, the axis of least depth is rarely
/// missed; p_a and p_b, on their surfaces, are then up to 0.1 of the size apart across the normal.
struct ClosestPoints {
  double distance = 0.0;  ///< gap [m]; negative: least translation that separates the bodies
  Eigen::Vector3d p_a = Eigen::Vector3d::Zero();      ///< on A's surface [m]
  Eigen::Vector3d p_b = Eigen::Vector3d::Zero();      ///< on B's surface [m]
  Eigen::Vector3d normal = Eigen::Vector3d::UnitZ();  ///< unit, from B to A
};

/// Returns the closest points of two bodies at their present poses, with `no_collision` too. Where
/// there are many pairs, as of parallel faces, both points are in the middle of them. Where the
/// bodies overlap, the points are those that come apart last while A moves along the normal. A
/// point mass is a sphere of radius 0. Of compounds the nearest or deepest two parts count. Throws
/// for unknown bodies, a body with itself, the world, and two planes.
ClosestPoints closest_points(const World& world, BodyId body_a, BodyId body_b);

}  // namespace constraint_sim::engine
