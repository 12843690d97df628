#include "engine/collision/closest_points.h"

#include <algorithm>
#include <cmath>
#include <utility>
#include <variant>
#include <vector>

#include "engine/collision/contact_tolerances.h"
#include "engine/collision/convex.h"
#include "engine/collision/narrowphase.h"
#include "engine/collision/polytope.h"
#include "engine/math/elementary.h"
#include "engine/math/numbers.h"

namespace constraint_sim::engine {
namespace {

using Eigen::Vector2d;
using Eigen::Vector3d;
using Flat = std::vector<Vector2d>;  // a point, a segment, or a polygon counter-clockwise

/// Height differences along the normal that a feature may have, as a share of the size: rounding of
/// normals.
constexpr double kFlatShare = 1e-9;

/// Corners of the part of a shape that is farthest along n, relative to its centre.
struct FarthestPart {
  Vector3d n;  // in the frame of the shape
  double tolerance;

  std::vector<Vector3d> operator()(const Point&) const { return {Vector3d::Zero()}; }
  std::vector<Vector3d> operator()(const Plane&) const { return {}; }
  std::vector<Vector3d> operator()(const Sphere& sphere) const { return {sphere.radius * n}; }
  std::vector<Vector3d> operator()(const Capsule& capsule) const {
    const Vector3d end(0.0, 0.0, std::copysign(0.5 * capsule.length, n.z()));
    if (std::abs(n.z()) * capsule.length > tolerance) return {end + capsule.radius * n};
    return {capsule.radius * n - end, capsule.radius * n + end};
  }
  std::vector<Vector3d> operator()(const Box& box) const {
    std::vector<Vector3d> corners{Vector3d::Zero()};
    for (int i = 0; i < 3; ++i) {
      const double half = std::copysign(0.5 * box.size[i], n[i]);
      const std::size_t count = corners.size();
      const bool both = std::abs(n[i]) * box.size[i] <= tolerance;
      for (std::size_t k = 0; k < count; ++k) {
        corners[k][i] = half;
        if (!both) continue;
        corners.push_back(corners[k]);
        corners.back()[i] = -half;
      }
    }
    return corners;
  }
  std::vector<Vector3d> operator()(const Cylinder& cylinder) const {
    const double across = math::hypot(n.x(), n.y());
    const double half = std::copysign(0.5 * cylinder.length, n.z());
    std::vector<Vector3d> corners;
    if (2.0 * cylinder.radius * across <= tolerance) {
      constexpr int kCorners = 64;  // corners of a polygon within the cap
      for (int k = 0; k < kCorners; ++k) {
        const math::SineCosine turn = math::sin_cos(2.0 * kPi * k / kCorners);
        corners.emplace_back(cylinder.radius * turn.cosine, cylinder.radius * turn.sine, half);
      }
      return corners;
    }
    const double scale = cylinder.radius / across;
    corners.emplace_back(scale * n.x(), scale * n.y(), half);
    if (std::abs(n.z()) * cylinder.length <= tolerance)
      corners.emplace_back(scale * n.x(), scale * n.y(), -half);
    return corners;
  }
  std::vector<Vector3d> operator()(const Hull& hull) const {
    const std::vector<Vector3d>& vertices = hull.surface->vertices();
    const double most = n.dot(vertices[static_cast<std::size_t>(hull.surface->farthest(n))]);
    std::vector<Vector3d> corners;
    for (const Vector3d& vertex : vertices)
      if (n.dot(vertex) >= most - tolerance) corners.push_back(vertex);
    return corners;
  }
};

double turn_of(const Vector2d& a, const Vector2d& b) { return a.x() * b.y() - a.y() * b.x(); }

/// Returns the convex hull of points in a plane (Andrew 1979).
Flat flat_hull(Flat points) {
  std::sort(points.begin(), points.end(), [](const Vector2d& a, const Vector2d& b) {
    return a.x() != b.x() ? a.x() < b.x() : a.y() < b.y();
  });
  if (points.size() < 3) return points;
  Flat hull;
  for (int half = 0; half < 2; ++half) {
    const std::size_t first = hull.size();
    for (const Vector2d& p : points) {
      while (hull.size() >= first + 2 &&
             turn_of(hull.back() - hull[hull.size() - 2], p - hull.back()) <= 0.0)
        hull.pop_back();
      hull.push_back(p);
    }
    hull.pop_back();  // begins the other half
    std::reverse(points.begin(), points.end());
  }
  return hull;
}

/// Returns the centre of the area, or the mean of the corners of a point or segment.
Vector2d middle_of(const Flat& flat) {
  Vector2d mean = Vector2d::Zero();
  for (const Vector2d& p : flat) mean += p / static_cast<double>(flat.size());
  double area = 0.0, size = 0.0;
  Vector2d moment = Vector2d::Zero();
  for (std::size_t k = 1; k + 1 < flat.size(); ++k) {
    const Vector2d p = flat[k] - flat[0], q = flat[k + 1] - flat[0];
    area += turn_of(p, q);
    moment += turn_of(p, q) / 3.0 * (p + q);
    size = std::max(size, p.squaredNorm());
  }
  return area > kFlatShare * size ? Vector2d(flat[0] + moment / area) : mean;
}

/// Returns the part of `flat` in a polygon (Sutherland & Hodgman 1974); empty where there is none.
Flat clipped(Flat flat, const Flat& polygon) {
  for (std::size_t i = 0; i < polygon.size(); ++i) {
    const Vector2d from = polygon[i], direction = polygon[(i + 1) % polygon.size()] - from;
    const auto height = [&](const Vector2d& p) { return turn_of(direction, p - from); };
    Flat inside;
    for (std::size_t k = 0; k < flat.size(); ++k) {
      const Vector2d &p = flat[k], &q = flat[(k + 1) % flat.size()];
      const double at_p = height(p), at_q = height(q);
      if (at_p >= 0.0) inside.push_back(p);
      if ((at_p < 0.0) != (at_q < 0.0)) inside.push_back(p + at_p / (at_p - at_q) * (q - p));
    }
    flat = std::move(inside);
  }
  return flat;
}

/// Returns the place on a segment that is nearest to a point.
Vector2d nearest_on_segment(const Vector2d& from, const Vector2d& to, const Vector2d& p) {
  const Vector2d direction = to - from;
  const double square = direction.squaredNorm();
  if (!(square > 0.0)) return from;
  return from + std::clamp(direction.dot(p - from) / square, 0.0, 1.0) * direction;
}

bool is_in(const Flat& polygon, const Vector2d& p) {
  if (polygon.size() < 3) return false;
  for (std::size_t k = 0; k < polygon.size(); ++k) {
    const Vector2d& from = polygon[k];
    if (turn_of(polygon[(k + 1) % polygon.size()] - from, p - from) < 0.0) return false;
  }
  return true;
}

/// Returns the point of a flat feature that is nearest to a point.
Vector2d nearest_in(const Flat& flat, const Vector2d& p) {
  if (is_in(flat, p)) return p;
  Vector2d nearest = flat[0];
  for (std::size_t k = 0; k < flat.size(); ++k) {
    const Vector2d q = nearest_on_segment(flat[k], flat[(k + 1) % flat.size()], p);
    if ((q - p).squaredNorm() < (nearest - p).squaredNorm()) nearest = q;
  }
  return nearest;
}

/// Points of two flat features.
struct FlatPair {
  Vector2d on_a, on_b;
  double square() const { return (on_a - on_b).squaredNorm(); }
};

/// Returns the middle of what two flat features have in common, or their nearest points where they
/// have nothing in common.
FlatPair middle_of_overlap(const Flat& a, const Flat& b) {
  if (a.size() == 2 && b.size() == 2) {
    const Vector2d along = a[1] - a[0], other = b[1] - b[0];
    const double turn = turn_of(along, other);
    const bool is_parallel = std::abs(turn) <= kFlatShare * along.norm() * other.norm();
    const Vector2d p = is_parallel ? Vector2d(0.5 * (nearest_on_segment(a[0], a[1], b[0]) +
                                                     nearest_on_segment(a[0], a[1], b[1])))
                                   : Vector2d(a[0] + turn_of(b[0] - a[0], other) / turn * along);
    const Vector2d on_b = nearest_in(b, nearest_in(a, p));
    return {nearest_in(a, on_b), on_b};
  }
  if (a.size() > 1 && b.size() > 1) {
    const Flat overlap = flat_hull(b.size() > 2 ? clipped(a, b) : clipped(b, a));
    if (!overlap.empty()) return {middle_of(overlap), middle_of(overlap)};
  }
  FlatPair nearest{a[0], nearest_in(b, a[0])};
  const auto attempt = [&](const FlatPair& pair) {
    if (pair.square() < nearest.square()) nearest = pair;
  };
  for (const Vector2d& p : a) attempt({p, nearest_in(b, p)});
  for (const Vector2d& p : b) attempt({nearest_in(a, p), p});
  return nearest;
}

/// Part of a shape that is farthest along a normal, projected along the third column of `axes` on
/// the plane of the first two.
struct SeenPart {
  Flat flat;
  double height;  // along the third axis, of the farthest point [m]

  SeenPart(const Shape& shape, const BodyState& state, const Vector3d& normal,
           const Vector3d& origin, const Eigen::Matrix3d& axes) {
    const double side = normal.dot(axes.col(2)) > 0.0 ? 1.0 : -1.0;
    const Vector3d n = state.orientation.conjugate() * normal;
    double most = -kInfinity;
    for (const Vector3d& corner :
         visit_convex(FarthestPart{n, kFlatShare * size_of(shape)}, shape)) {
      const Vector3d seen =
          axes.transpose() * (state.position - origin + state.orientation * corner);
      flat.push_back(seen.head<2>());
      most = std::max(most, side * seen.z());
    }
    height = side * most;
    flat = flat_hull(std::move(flat));
  }
};

/// Returns a sphere of radius 0 for a point.
Shape solid_of(const Shape& shape) {
  return std::holds_alternative<Point>(shape) ? Shape(Sphere{0.0}) : shape;
}

/// Returns the separation along the nearest points. Boxes that are apart at corners or edges have a
/// smaller gap along the axes that separation_of_boxes() tries.
Separation nearest_separation(const Shape& shape_a, const BodyState& a, const Shape& shape_b,
                              const BodyState& b) {
  const Separation found = separation(shape_a, a, shape_b, b);
  const auto *box_a = std::get_if<Box>(&shape_a), *box_b = std::get_if<Box>(&shape_b);
  if (box_a == nullptr || box_b == nullptr || !(found.gap > 0.0)) return found;
  const NearestPoints nearest = nearest_points(Polytope(box_a->size, a, b.position),
                                               Polytope(box_b->size, b, b.position), kInfinity);
  // The gap along an axis that serves is exact to rounding, this share of the size.
  constexpr double kSeparationRounding = 1e-14;
  const double rounding = kSeparationRounding * std::max(size_of(shape_a), size_of(shape_b));
  if (!(nearest.distance > found.gap + rounding)) return found;
  return {(nearest.on_a - nearest.on_b) / nearest.distance, nearest.distance};
}

/// Returns the point of a shape that is nearest to a point outside.
Vector3d projected(const Vector3d& point, const Shape& shape, const BodyState& state) {
  BodyState at_point;
  at_point.position = point;
  const Separation found = separation(Sphere{0.0}, at_point, shape, state);
  return point - found.gap * found.normal;
}

/// Corrects points of shapes that are apart, where the normal was not exact, by projections in turn
/// (Cheney & Goldstein 1959).
void approach(const Shape& shape_a, const BodyState& a, const Shape& shape_b, const BodyState& b,
              ClosestPoints* points) {
  constexpr int kMostPointProjections = 100;
  const double size = std::max(size_of(shape_a), size_of(shape_b));
  for (int i = 0; i < kMostPointProjections; ++i) {
    const Vector3d direction = points->p_a - points->p_b;
    if ((direction - points->distance * points->normal).norm() <= kFlatShare * size) return;
    points->p_a = projected(points->p_b, shape_a, a);
    const Vector3d p_b = projected(points->p_a, shape_b, b);
    const bool is_there = (p_b - points->p_b).norm() <= 0.1 * kFlatShare * size;
    points->p_b = p_b;
    points->distance = (points->p_a - p_b).norm();
    if (points->distance > 0.0) points->normal = (points->p_a - p_b) / points->distance;
    if (is_there) return;
  }
}

/// Returns axes whose third one is n.
Eigen::Matrix3d axes_along(const Vector3d& n) {
  Eigen::Index least = 0;
  n.cwiseAbs().minCoeff(&least);
  Eigen::Matrix3d axes;
  axes.col(0) = n.cross(Vector3d::Unit(least)).normalized();
  axes.col(1) = n.cross(axes.col(0));
  axes.col(2) = n;
  return axes;
}

}  // namespace

ClosestPoints closest_points_of(const Shape& shape_a, const BodyState& a, const Shape& shape_b,
                                const BodyState& b) {
  const Shape of_a = solid_of(shape_a), of_b = solid_of(shape_b);
  const Separation apart = nearest_separation(of_a, a, of_b, b);
  const Vector3d& n = apart.normal;
  const bool is_a_plane = std::holds_alternative<Plane>(of_a);
  const bool is_b_plane = std::holds_alternative<Plane>(of_b);
  const Vector3d& origin = is_b_plane ? a.position : b.position;
  const Eigen::Matrix3d axes = axes_along(n);
  const SeenPart part_a(of_a, a, -n, origin, axes), part_b(of_b, b, n, origin, axes);
  const auto place = [&](const Vector2d& p, double height) -> Vector3d {
    return origin + axes * Vector3d(p.x(), p.y(), height);
  };
  ClosestPoints points{apart.gap, {}, {}, n};
  if (is_a_plane || is_b_plane) {
    const SeenPart& part = is_a_plane ? part_b : part_a;
    const Vector3d on_body = place(middle_of(part.flat), part.height);
    points.p_a = is_a_plane ? on_body + apart.gap * n : on_body;
    points.p_b = is_a_plane ? on_body : on_body - apart.gap * n;
    return points;
  }
  const FlatPair common = middle_of_overlap(part_a.flat, part_b.flat);
  points.p_a = place(common.on_a, part_a.height);
  points.p_b = place(common.on_b, part_b.height);
  if (apart.gap > 0.0) approach(of_a, a, of_b, b, &points);
  return points;
}

}  // namespace constraint_sim::engine
