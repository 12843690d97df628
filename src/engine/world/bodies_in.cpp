#include <algorithm>

#include "constraint_sim/engine/region.h"
#include "engine/collision/broadphase.h"
#include "engine/islands/motion_bounds.h"
#include "engine/model/validate.h"
#include "engine/world/world_impl.h"

namespace constraint_sim::engine {
namespace {

/// Whether the half-space below a plane reaches into a region: its lowest corner is not above.
bool reaches_into(const BodyState& plane, const Aabb& region) {
  const Eigen::Vector3d N = plane.orientation * Eigen::Vector3d::UnitZ();
  const Eigen::Vector3d lowest = (N.array() > 0.0).select(region.min, region.max);
  return N.dot(lowest - plane.position) <= 0.0;
}

}  // namespace

std::vector<BodyId> bodies_in(const World& world, const Eigen::Vector3d& min,
                              const Eigen::Vector3d& max) {
  check_finite("min", min);
  check_finite("max", max);
  if (!(min.array() <= max.array()).all())
    refuse("max", "must be at least min, " + shown(min) + ", got " + shown(max));
  const WorldImpl& impl = ImplAccess::of(world);
  const Aabb region{min, max};
  std::vector<BodyId> found;
  List<Proxy> proxies;
  for (std::size_t i = 1; i < impl.bodies.size(); ++i) {  // behind the world itself
    proxies.clear();
    add_proxies(impl, impl.states[i], static_cast<int>(i), 0.0, &proxies);
    const auto is_in = [&](const Proxy& proxy) {
      const bool is_plane = !proxy.box.min.allFinite();
      return is_plane ? reaches_into(impl.states[i], region) : overlap(proxy.box, region);
    };
    if (std::any_of(proxies.begin(), proxies.end(), is_in)) found.push_back(impl.body_ids[i]);
  }
  return found;
}

}  // namespace constraint_sim::engine
