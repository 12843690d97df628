#pragma once

#include <constraint_sim/BodiesIn.h>
#include <constraint_sim/CastRay.h>
#include <constraint_sim/ClosestPoints.h>

#include "constraint_sim/engine/world.h"

namespace constraint_sim {

/// Answers a request for a ray from the present poses, all but `header` and `success`. Throws
/// std::invalid_argument for numbers out of range and unknown bodies.
void cast_ray(const engine::World& world, const CastRayRequest& request, CastRayResponse* response);

/// Answers a request for the closest points of two bodies, all but `header` and `success`. Throws
/// std::invalid_argument for unknown bodies, a body with itself and two planes.
void closest_points(const engine::World& world, const ClosestPointsRequest& request,
                    ClosestPointsResponse* response);

/// Answers a request for the bodies in a region, all but `success`. Throws std::invalid_argument
/// for corners out of range.
void bodies_in(const engine::World& world, const BodiesInRequest& request,
               BodiesInResponse* response);

}  // namespace constraint_sim
