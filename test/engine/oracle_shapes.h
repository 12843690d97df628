#pragma once

// Shapes with closed forms: how far a point is outside, and how far the shape reaches.

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <variant>
#include <vector>

#include "constraint_sim/engine/shape.h"
#include "draw.h"
#include "engine/math/numbers.h"

namespace constraint_sim::engine {

using Exact = long double;
using Exact3 = Eigen::Matrix<Exact, 3, 1>;

struct HalfSpace {
  Exact3 normal;
  Exact offset;
};

/// A shape, the planes of a hull, and its size [m]. A plane of a hull goes through three
/// points and has all others on one side; Qhull is not used.
struct OracleShape {
  Shape shape;
  std::vector<HalfSpace> planes;
  std::vector<Eigen::Vector3d> points;
  double size = 1.0;
};

/// The half-spaces of the hull of points in general position.
inline std::vector<HalfSpace> planes_of(const std::vector<Eigen::Vector3d>& points) {
  std::vector<HalfSpace> planes;
  for (std::size_t i = 0; i < points.size(); ++i)
    for (std::size_t j = i + 1; j < points.size(); ++j)
      for (std::size_t k = j + 1; k < points.size(); ++k) {
        const Exact3 a = points[i].cast<Exact>();
        Exact3 n = (points[j].cast<Exact>() - a).cross(points[k].cast<Exact>() - a).normalized();
        int above = 0, below = 0;
        for (std::size_t l = 0; l < points.size(); ++l) {
          if (l == i || l == j || l == k) continue;
          (n.dot(points[l].cast<Exact>() - a) > 0 ? above : below) += 1;
        }
        if (above > 0 && below > 0) continue;
        if (above > 0) n = -n;
        planes.push_back({n, n.dot(a)});
      }
  return planes;
}

inline OracleShape random_oracle_shape(int kind, double scale, Draw* draw) {
  const auto size = [&] { return scale * draw->between(0.2, 0.8); };
  OracleShape target;
  target.size = scale;
  if (kind == 0) target.shape = Sphere{0.5 * size()};
  if (kind == 1) target.shape = Box{{size(), size(), size()}};
  if (kind == 2) target.shape = Cylinder{0.5 * size(), size()};
  if (kind == 3) target.shape = Capsule{0.3 * size(), size()};
  if (kind == 4) target.shape = Plane{};
  if (kind == 5) {
    for (int i = 0; i < 12; ++i) target.points.push_back(0.4 * scale * draw->vector());
    target.planes = planes_of(target.points);
    target.shape = Hull(target.points);
  }
  return target;
}
inline constexpr int kOracleShapes = 6;
static_assert(kOracleShapes + 2 == std::variant_size_v<Shape>, "all but points and compounds");

/// Returns how far a point in the frame of the shape is outside: convex, 0 on the surface.
inline Exact height_over(const OracleShape& target, const Exact3& x) {
  const Exact around = std::hypot(x.x(), x.y());
  if (const auto* sphere = std::get_if<Sphere>(&target.shape)) return x.norm() - sphere->radius;
  if (const auto* box = std::get_if<Box>(&target.shape))
    return (x.cwiseAbs() - Exact(0.5) * box->size.cast<Exact>()).maxCoeff();
  if (const auto* cylinder = std::get_if<Cylinder>(&target.shape))
    return std::max(around - cylinder->radius, std::abs(x.z()) - Exact(0.5) * cylinder->length);
  if (const auto* capsule = std::get_if<Capsule>(&target.shape))
    return std::hypot(around, std::max(Exact(0), std::abs(x.z()) - Exact(0.5) * capsule->length)) -
           capsule->radius;
  if (std::holds_alternative<Plane>(target.shape)) return x.z();
  Exact most = -1e30L;
  for (const HalfSpace& plane : target.planes)
    most = std::max(most, plane.normal.dot(x) - plane.offset);
  return most;
}

/// Returns the greatest coordinate of the shape along n, both in the frame of the shape.
inline double support_of(const OracleShape& target, const Eigen::Vector3d& n) {
  if (const auto* sphere = std::get_if<Sphere>(&target.shape)) return sphere->radius;
  if (const auto* box = std::get_if<Box>(&target.shape)) return 0.5 * box->size.dot(n.cwiseAbs());
  if (const auto* cylinder = std::get_if<Cylinder>(&target.shape))
    return cylinder->radius * n.head<2>().norm() + 0.5 * cylinder->length * std::abs(n.z());
  if (const auto* capsule = std::get_if<Capsule>(&target.shape))
    return capsule->radius + 0.5 * capsule->length * std::abs(n.z());
  if (std::holds_alternative<Plane>(target.shape)) return n.z() > 1.0 - 1e-12 ? 0.0 : kInfinity;
  double most = -kInfinity;
  for (const Eigen::Vector3d& point : target.points) most = std::max(most, n.dot(point));
  return most;
}

}  // namespace constraint_sim::engine
