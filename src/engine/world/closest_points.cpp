#include "engine/collision/closest_points.h"

#include "engine/collision/placed_shape.h"
#include "engine/islands/motion_bounds.h"
#include "engine/math/numbers.h"
#include "engine/model/validate.h"
#include "engine/world/world_impl.h"

namespace constraint_sim::engine {
namespace {

/// Returns the distance of two boxes [m]; 0 where they overlap.
double distance_of(const Aabb& a, const Aabb& b) {
  return (a.min - b.max).cwiseMax(b.min - a.max).cwiseMax(0.0).norm();
}

}  // namespace

ClosestPoints closest_points(const World& world, BodyId body_a, BodyId body_b) {
  const WorldImpl& impl = ImplAccess::of(world);
  const std::size_t a = impl.index(body_a), b = impl.index(body_b);
  if (a == 0 || b == 0) refuse(a == 0 ? "body_a" : "body_b", "the world itself has no shape");
  if (a == b) refuse("body_b", "must not be body_a, got " + in_quotes(impl.bodies[b].name));
  const auto is_plane = [&](std::size_t body) { return extent(impl.bodies[body]) == kInfinity; };
  if (is_plane(a) && is_plane(b))
    refuse("body_b", "two planes have no closest points, got " + in_quotes(impl.bodies[a].name) +
                         " and " + in_quotes(impl.bodies[b].name));
  List<Proxy> parts_a, parts_b;
  add_proxies(impl, impl.states[a], static_cast<int>(a), 0.0, &parts_a);
  add_proxies(impl, impl.states[b], static_cast<int>(b), 0.0, &parts_b);
  ClosestPoints nearest;
  nearest.distance = kInfinity;
  for (const Proxy& i : parts_a) {
    const PlacedShape of_a(impl.bodies[a], i.part, impl.states[a]);
    for (const Proxy& j : parts_b) {
      if (distance_of(i.box, j.box) > nearest.distance) continue;
      const PlacedShape of_b(impl.bodies[b], j.part, impl.states[b]);
      const ClosestPoints found =
          closest_points_of(of_a.shape(), of_a.state(), of_b.shape(), of_b.state());
      if (found.distance < nearest.distance) nearest = found;
    }
  }
  return nearest;
}

}  // namespace constraint_sim::engine
