#pragma once

#include "constraint_sim/engine/body.h"
#include "constraint_sim/engine/closest_points.h"

namespace constraint_sim::engine {

/// Returns the closest points of two convex shapes, at most one of which is a plane. Distance and
/// normal are those of separation(). The points are on the features that are farthest along the
/// normal, where their projections along it overlap.
ClosestPoints closest_points_of(const Shape& shape_a, const BodyState& a, const Shape& shape_b,
                                const BodyState& b);

}  // namespace constraint_sim::engine
