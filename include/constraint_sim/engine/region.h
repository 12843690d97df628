#pragma once

#include <Eigen/Core>
#include <vector>

#include "constraint_sim/engine/id.h"

namespace constraint_sim::engine {

class World;

/// Returns all bodies whose bounding box along the world's axes shares a point with the box from
/// `min` to `max` (world frame [m]), at the present poses, in the order of adding. Bounding
/// boxes of spheres and of bodies along the axes are tight; another body may be listed that ends
/// just beside the region. A plane is the half-space below it, without a bounding box, and exact.
/// Points and bodies with `no_collision` are listed too, the world itself is not. Throws for
/// numbers that are not finite or beyond 1e20, and for a `max` below `min`.
std::vector<BodyId> bodies_in(const World& world, const Eigen::Vector3d& min,
                              const Eigen::Vector3d& max);

}  // namespace constraint_sim::engine
