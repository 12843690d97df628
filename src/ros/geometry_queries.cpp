#include "ros/geometry_queries.h"

#include <optional>
#include <string>
#include <vector>

#include "constraint_sim/engine/closest_points.h"
#include "constraint_sim/engine/ray.h"
#include "constraint_sim/engine/region.h"
#include "ros/conversions.h"

namespace constraint_sim {

void cast_ray(const engine::World& world, const CastRayRequest& request,
              CastRayResponse* response) {
  const engine::BodyState& frame =
      world.state(find_body(world, "reference_frame", request.reference_frame));
  std::vector<engine::BodyId> ignored;
  ignored.reserve(request.ignored.size());
  for (const std::string& name : request.ignored)
    ignored.push_back(
        find_own_body(world, "ignored[" + std::to_string(ignored.size()) + "]", name));
  engine::Ray ray;
  ray.origin = frame.position + frame.orientation * from_msg(request.origin);
  ray.direction = frame.orientation * from_msg(request.direction);
  if (request.max_distance != 0.0) ray.max_distance = request.max_distance;
  const std::optional<engine::RayHit> hit = engine::cast_ray(world, ray, ignored);
  response->hit = hit.has_value();
  if (!hit) return;
  const Eigen::Quaterniond to_frame = frame.orientation.conjugate();
  response->body = world.body(hit->body).name;
  response->distance = finite(hit->distance);
  response->point = to_point(to_frame * (hit->point - frame.position));
  response->normal = to_vector(to_frame * hit->normal);
  response->inside = hit->inside;
}

void closest_points(const engine::World& world, const ClosestPointsRequest& request,
                    ClosestPointsResponse* response) {
  const engine::BodyId a = find_own_body(world, "body_a", request.body_a);
  const engine::BodyId b = find_own_body(world, "body_b", request.body_b);
  const engine::ClosestPoints points = engine::closest_points(world, a, b);
  response->distance = points.distance;
  response->point_a = to_point(points.p_a);
  response->point_b = to_point(points.p_b);
  response->normal = to_vector(points.normal);
}

void bodies_in(const engine::World& world, const BodiesInRequest& request,
               BodiesInResponse* response) {
  for (const engine::BodyId id :
       engine::bodies_in(world, from_msg(request.min), from_msg(request.max)))
    response->bodies.push_back(world.body(id).name);
}

}  // namespace constraint_sim
