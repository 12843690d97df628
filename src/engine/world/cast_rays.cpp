// Rays against the bodies of a world.

#include <algorithm>
#include <stdexcept>
#include <string>

#include "constraint_sim/engine/ray.h"
#include "engine/collision/placed_shape.h"
#include "engine/collision/ray.h"
#include "engine/islands/motion_bounds.h"
#include "engine/math/list.h"
#include "engine/model/validate.h"
#include "engine/world/world_impl.h"

namespace constraint_sim::engine {
namespace {

// Planes reach farther; products of coordinates of a hit stay finite.
constexpr double kHorizon = 1e30;  // [m]
// Shares of a radius and of coordinates relative to the ray that exceed the rounding of a hit.
constexpr double kRadiusRounding = 1e-12, kCoordinateRounding = 1e-14;

void check_ray(const Ray& ray) {
  check_finite("origin", ray.origin);
  check_axis("direction", ray.direction);
  if (!(ray.max_distance > 0.0))
    refuse("max_distance", "must be a number > 0, got " + shortest(ray.max_distance));
}

/// Convex shapes that rays can hit, with bounding spheres about the centres of their bodies.
class RayTargets {
 public:
  RayTargets(const Model& model, const State& state, const std::vector<BodyId>& ignored)
      : model_(model), state_(state) {
    List<bool> is_ignored(model.bodies.size(), false);
    for (const BodyId id : ignored) is_ignored[model.index(id)] = true;
    for (std::size_t i = 0; i < model.bodies.size(); ++i) {
      const double radius = extent(model.bodies[i]);
      if (!(radius > 0.0) || is_ignored[i]) continue;  // points have none
      const int parts = static_cast<int>(part_count(model.bodies[i].shape));
      for (int part = 0; part < parts; ++part)
        targets_.push_back({state.states[i].position, radius, i, part});
    }
  }

  std::optional<RayHit> first_hit(const Ray& ray) const {
    // Scaled by the largest component first, whose square may be beyond the range of doubles.
    const Eigen::Vector3d direction =
        (ray.direction / ray.direction.lpNorm<Eigen::Infinity>()).normalized();
    std::optional<RayHit> hit;
    double nearest = std::min(ray.max_distance, kHorizon);
    for (const Target& target : targets_) {
      if (!target.may_be_hit(ray.origin, direction, nearest)) continue;
      const PlacedShape placed(model_.bodies[target.body], target.part, state_.states[target.body]);
      const std::optional<LinePart> part =
          line_part_in(placed.shape(), placed.state(), ray.origin, direction);
      if (!part || !(part->exit > 0.0)) continue;
      const double distance = std::max(part->enter, 0.0);
      // The first of several bodies at one distance is hit.
      if (hit ? distance >= nearest : distance > nearest) continue;
      nearest = distance;
      const bool inside = part->enter < 0.0;
      hit = RayHit{model_.body_ids[target.body], distance, ray.origin + distance * direction,
                   inside ? Eigen::Vector3d(-direction) : part->normal, inside};
    }
    return hit;
  }

 private:
  struct Target {
    Eigen::Vector3d centre;
    double radius;  // infinite of planes
    std::size_t body;
    int part;  // number of the shape in the body

    /// Whether a part of the ray up to a distance may be in the sphere. The margin exceeds the
    /// rounding of the nearest point of the line.
    bool may_be_hit(const Eigen::Vector3d& origin, const Eigen::Vector3d& direction,
                    double distance) const {
      const Eigen::Vector3d to_centre = centre - origin;
      const double along = to_centre.dot(direction);
      const double margin =
          (1.0 + kRadiusRounding) * radius + kCoordinateRounding * to_centre.lpNorm<1>();
      if (along < -margin || along - margin > distance) return false;
      return !((to_centre - along * direction).squaredNorm() > margin * margin);
    }
  };

  const Model& model_;
  const State& state_;
  List<Target> targets_;  // in the order of adding
};

}  // namespace

std::optional<RayHit> cast_ray(const World& world, const Ray& ray,
                               const std::vector<BodyId>& ignored) {
  check_ray(ray);
  const WorldImpl& impl = ImplAccess::of(world);
  return RayTargets(impl, impl, ignored).first_hit(ray);
}

std::vector<std::optional<RayHit>> cast_rays(const World& world, const std::vector<Ray>& rays,
                                             const std::vector<BodyId>& ignored) {
  for (std::size_t i = 0; i < rays.size(); ++i) {
    try {
      check_ray(rays[i]);
    } catch (const std::invalid_argument& error) {
      throw std::invalid_argument("rays[" + std::to_string(i) + "]." + error.what());
    }
  }
  const WorldImpl& impl = ImplAccess::of(world);
  const RayTargets targets(impl, impl, ignored);
  std::vector<std::optional<RayHit>> hits;
  hits.reserve(rays.size());
  for (const Ray& ray : rays) hits.push_back(targets.first_hit(ray));
  return hits;
}

}  // namespace constraint_sim::engine
