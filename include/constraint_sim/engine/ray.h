#pragma once

#include <Eigen/Core>
#include <limits>
#include <optional>
#include <vector>

#include "constraint_sim/engine/id.h"

namespace constraint_sim::engine {

class World;

/// A half-line in the world frame.
struct Ray {
  Eigen::Vector3d origin = Eigen::Vector3d::Zero();      ///< [m]
  Eigen::Vector3d direction = Eigen::Vector3d::UnitX();  ///< any length > 0
  /// Greatest distance from the origin at which a body is hit [m] > 0, whatever the length of
  /// `direction`; may be infinite, and planes are hit up to 1e30 m.
  double max_distance = std::numeric_limits<double>::infinity();
};

/// The first place of a ray that is inside a body, world frame.
///
/// Shapes are solids without their surface, and a plane is the half-space below it. So a ray that
/// touches a shape without entering it hits nothing, and a ray that starts on a surface hits the
/// body at distance 0 if it goes inwards, else not. A ray that starts inside a body hits it at
/// distance 0. A compound is hit at the first of its parts. Rounding decides within 1e-15 of the
/// coordinates that take part.
struct RayHit {
  BodyId body;
  double distance = 0.0;                              ///< from the origin [m] ≥ 0
  Eigen::Vector3d point = Eigen::Vector3d::Zero();    ///< on the surface; inside: the origin [m]
  Eigen::Vector3d normal = Eigen::Vector3d::UnitZ();  ///< unit, outward; inside: against the ray
  bool inside = false;                                ///< whether the ray starts inside the body
};

/// Returns the first body that a ray hits, at the present poses; of bodies at one distance the
/// first in the order of adding. Every body with a shape is seen, with `no_collision` too; points
/// have none. Bodies in `ignored` are passed through. Throws for numbers that are not finite or
/// beyond 1e20, a direction of length 0, a distance that is not > 0, and unknown bodies.
std::optional<RayHit> cast_ray(const World& world, const Ray& ray,
                               const std::vector<BodyId>& ignored = {});

/// Returns the hit of each ray, as cast_ray(). Many rays at once take less time than one by one.
std::vector<std::optional<RayHit>> cast_rays(const World& world, const std::vector<Ray>& rays,
                                             const std::vector<BodyId>& ignored = {});

}  // namespace constraint_sim::engine
