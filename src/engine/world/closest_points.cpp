#include "engine/collision/closest_points.h"

#include "engine/collision/narrowphase.h"
#include "engine/islands/motion_bounds.h"
#include "engine/math/numbers.h"
#include "engine/model/validate.h"
#include "engine/world/world_impl.h"

namespace constraint_sim::engine {

ClosestPoints closest_points(const World& world, BodyId body_a, BodyId body_b) {
  const WorldImpl& impl = ImplAccess::of(world);
  const std::size_t a = impl.index(body_a), b = impl.index(body_b);
  if (a == 0 || b == 0) refuse(a == 0 ? "body_a" : "body_b", "the world itself has no shape");
  if (a == b) refuse("body_b", "must not be body_a, got " + in_quotes(impl.bodies[b].name));
  const auto is_plane = [&](std::size_t body) { return extent(impl.bodies[body]) == kInfinity; };
  if (is_plane(a) && is_plane(b))
    refuse("body_b", "two planes have no closest points, got " + in_quotes(impl.bodies[a].name) +
                         " and " + in_quotes(impl.bodies[b].name));
  ClosestPoints nearest;
  const int parts_a = static_cast<int>(part_count(impl.bodies[a].shape));
  const int parts_b = static_cast<int>(part_count(impl.bodies[b].shape));
  for (int i = 0; i < parts_a; ++i) {
    const PlacedShape of_a(impl.bodies[a], i, impl.states[a]);
    for (int j = 0; j < parts_b; ++j) {
      const PlacedShape of_b(impl.bodies[b], j, impl.states[b]);
      const ClosestPoints found =
          closest_points_of(of_a.shape(), of_a.state(), of_b.shape(), of_b.state());
      if ((i == 0 && j == 0) || found.distance < nearest.distance) nearest = found;
    }
  }
  return nearest;
}

}  // namespace constraint_sim::engine
