// Contacts of a capsule with planes, spheres, capsules and cylinders.

#include <algorithm>
#include <cmath>
#include <optional>

#include "engine/collision/capsule_points.h"
#include "engine/collision/narrowphase.h"
#include "engine/collision/narrowphase_tolerances.h"

namespace constraint_sim::engine {
namespace {

using Eigen::Vector3d;

// ---- capsules

/// Nearest points of two lines, as places along each.
struct LinePlaces {
  double s = 0.0, t = 0.0;
  double square = kInfinity;  ///< square of the distance [m²]
};

LinePlaces nearest_places(const Segment& a, const Segment& b) {
  LinePlaces nearest;
  const auto attempt = [&](double s, double t) {
    const double square = (a.at(s) - b.at(t)).squaredNorm();
    if (square < nearest.square) nearest = {s, t, square};
  };
  // Ends, which are nearest where the lines are parallel.
  for (const double end : {-a.half, a.half}) attempt(end, b.nearest(a.at(end)));
  for (const double end : {-b.half, b.half}) attempt(a.nearest(b.at(end)), end);
  const double cosine = a.axis.dot(b.axis);
  const double square_of_sine = a.axis.cross(b.axis).squaredNorm();
  if (square_of_sine < kSmallestSquare) return nearest;
  const Vector3d apart = b.centre - a.centre;
  const double s = (a.axis.dot(apart) - cosine * b.axis.dot(apart)) / square_of_sine;
  const double t = b.nearest(a.at(std::clamp(s, -a.half, a.half)));
  attempt(a.nearest(b.at(t)), t);
  return nearest;
}

LineGap gap_of(const Segment& a, const Segment& b) {
  const LinePlaces places = nearest_places(a, b);
  LineGap found;
  found.on_b = b.at(places.t);
  found.gap = std::sqrt(places.square);
  found.feature = kMiddle * kEndCode;
  const double size = a.half + b.half;
  if (found.gap > kTouchingShare * size) {
    found.normal = (a.at(places.s) - found.on_b) / found.gap;
    return found;
  }
  // Lines that cross part along their common normal, parallel ones across them.
  const Vector3d cross = a.axis.cross(b.axis);
  const double sine = cross.norm();
  found.normal = sine > kParallelSine ? Vector3d(cross / sine) : a.axis.unitOrthogonal();
  if (found.normal.dot(a.centre - b.centre) < 0.0) found.normal = -found.normal;
  found.gap = -a.support_extent(-found.normal) - b.support_extent(found.normal);
  return found;
}

// ---- cylinders

Vector3d nearest_on(const Solid& cylinder, const Vector3d& point) {
  Vector3d p = cylinder.axes.transpose() * (point - cylinder.centre);
  const double across = p.head<2>().norm();
  if (across > cylinder.radius()) p.head<2>() *= cylinder.radius() / across;
  p.z() = std::clamp(p.z(), -cylinder.half.z(), cylinder.half.z());
  return cylinder.centre + cylinder.axes * p;
}

/// Returns the place of a line that is nearest to a cylinder. The square of the distance is convex
/// along the line.
double nearest_place(const Segment& line, const Solid& cylinder) {
  const auto slope = [&](double s) {
    const Vector3d p = line.at(s);
    return line.axis.dot(p - nearest_on(cylinder, p));
  };
  double low = -line.half, high = line.half;
  if (slope(low) >= 0.0) return low;
  if (slope(high) <= 0.0) return high;
  for (int i = 0; i < kMostBisections; ++i) {
    const double middle = 0.5 * (low + high);
    (slope(middle) > 0.0 ? high : low) = middle;
  }
  return 0.5 * (low + high);
}

LineGap gap_of(const Segment& line, const Solid& b) {
  const Vector3d p = line.at(nearest_place(line, b));
  LineGap found;
  found.on_b = nearest_on(b, p);
  found.feature = kMiddle * kEndCode;
  const Vector3d apart = p - found.on_b;
  found.gap = apart.norm();
  if (found.gap > kTouchingShare * (line.half + b.half.sum())) {
    found.normal = apart / found.gap;
    return found;
  }
  const Solid thin(line);
  LeastDepthAxis axis(thin, b);
  axis.find(kInfinity);
  found.normal = axis.normal();
  found.gap = -axis.depth();
  const bool is_level = std::abs(found.normal.dot(line.axis)) <= kFlatSine;
  found.on_b = is_level
                   ? Vector3d(b.centre + b.farthest(found.normal))
                   : Vector3d(line.vertex(line.farthest(-found.normal)) - found.gap * found.normal);
  return found;
}

/// Returns the part of a line over a cap, seen along the normal of the cap.
std::optional<PlaceRange> line_over_cap(const Segment& line, const Solid& cylinder) {
  const auto in_cap = [&](const Vector3d& d) -> Vector3d {
    return d - cylinder.axis() * cylinder.axis().dot(d);
  };
  const Vector3d x = in_cap(line.centre - cylinder.centre), d = in_cap(line.axis);
  const double radius = cylinder.radius() * (1.0 + kWiderShare);
  const double place = -x.dot(d) / d.squaredNorm();
  const double square = radius * radius - (x + place * d).squaredNorm();
  if (!(square >= 0.0)) return std::nullopt;
  const double half = std::sqrt(square / d.squaredNorm());
  const PlaceRange part{std::max(-line.half, place - half), std::min(line.half, place + half)};
  if (part.from > part.to) return std::nullopt;
  return part;
}

}  // namespace

Manifold Collide::operator()(const Capsule& capsule_a, const Plane&) const {
  const Vector3d N = normal_of_plane(b);
  const double d = N.dot(b.position);
  const Segment line = middle_line(capsule_a, a, Vector3d::Zero());
  Manifold manifold;
  manifold.normal = N;
  for (const int end : {0, 1}) {
    const Vector3d p = line.vertex(end);
    const double height = N.dot(p) - d;
    add_point(manifold, p - height * N, capsule_a.radius - height, static_cast<std::uint32_t>(end),
              margin);
  }
  return manifold;
}

Manifold Collide::operator()(const Capsule& capsule_a, const Sphere& sphere_b) const {
  const Segment line = middle_line(capsule_a, a, b.position);
  const Vector3d p = line.at(line.nearest(Vector3d::Zero()));
  const double square = p.squaredNorm();
  Manifold manifold;
  // A centre on the line leaves across it.
  manifold.normal =
      square >= kSmallestSquare ? Vector3d(p / std::sqrt(square)) : line.axis.unitOrthogonal();
  add_point(manifold, b.position + sphere_b.radius * manifold.normal,
            capsule_a.radius + sphere_b.radius - std::sqrt(square), 0, margin);
  return manifold;
}

Manifold Collide::operator()(const Capsule& capsule_a, const Capsule& capsule_b) const {
  const Segment line = middle_line(capsule_a, a, b.position);
  const Segment other = middle_line(capsule_b, b, b.position);
  const double radii = capsule_a.radius + capsule_b.radius;
  const LineGap found = gap_of(line, other);
  const auto add_feature = [&](const Vector3d& n) {
    CapsulePoints points(line, radii, n, b.position, margin);
    if (line.axis.cross(other.axis).norm() <= kAlongSine)
      if (const auto part = line_beside(line, other.vertex(0), other.vertex(1)))
        points.add_ends(*part, 0, [&](const Vector3d& p) { return other.at(other.nearest(p)); });
    return points;
  };
  Manifold manifold = contact_of_capsule(line, radii, found, b.position, margin, add_feature);
  for (int i = 0; i < manifold.count; ++i)
    manifold.points[static_cast<std::size_t>(i)].position += capsule_b.radius * manifold.normal;
  return manifold;
}

Manifold Collide::operator()(const Capsule& capsule_a, const Cylinder& cylinder_b) const {
  const Segment line = middle_line(capsule_a, a, b.position);
  const Solid cylinder(cylinder_b, b, b.position);
  const Vector3d k = cylinder.axis();
  const auto add_feature = [&](const Vector3d& n) {
    const double cosine = n.dot(k);
    const bool is_on_cap = std::abs(cosine) >= kFaceCosine;
    const Vector3d N = cosine < 0.0 ? Vector3d(-k) : k;
    CapsulePoints points(line, capsule_a.radius, is_on_cap ? N : n, b.position, margin);
    if (is_on_cap) {
      if (const std::optional<PlaceRange> part = line_over_cap(line, cylinder))
        points.add_ends(*part, cosine < 0.0 ? 1 : 2, [&](const Vector3d& p) -> Vector3d {
          return p + (cylinder.half.z() - N.dot(p)) * N;
        });
    } else if (std::abs(cosine) <= kFlatSine && line.axis.cross(k).norm() <= kAlongSine) {
      const Vector3d radial = cylinder.radius() * (n - cosine * k).normalized();
      const auto part = line_beside(line, cylinder.cap_centre(-1), cylinder.cap_centre(1));
      if (part)
        points.add_ends(*part, 3,
                        [&](const Vector3d& p) -> Vector3d { return radial + k.dot(p) * k; });
    }
    return points;
  };
  return contact_of_capsule(line, capsule_a.radius, gap_of(line, cylinder), b.position, margin,
                            add_feature);
}

Separation Separate::operator()(const Capsule& capsule_a, const Capsule& capsule_b) const {
  const LineGap found =
      gap_of(middle_line(capsule_a, a, b.position), middle_line(capsule_b, b, b.position));
  return {found.normal, found.gap - capsule_a.radius - capsule_b.radius};
}

Separation Separate::operator()(const Capsule& capsule_a, const Cylinder& cylinder_b) const {
  const LineGap found =
      gap_of(middle_line(capsule_a, a, b.position), Solid(cylinder_b, b, b.position));
  return {found.normal, found.gap - capsule_a.radius};
}

}  // namespace constraint_sim::engine
