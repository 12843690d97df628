#include "engine/collision/ray.h"

#include <algorithm>
#include <cmath>
#include <variant>

#include "engine/collision/convex.h"
#include "engine/collision/manifold_points.h"
#include "engine/math/list.h"
#include "engine/math/numbers.h"

namespace constraint_sim::engine {
namespace {

using Eigen::Vector2d;
using Eigen::Vector3d;

/// The part of a line inside several half-spaces, by clipping (Kay & Kajiya 1986).
class ClippedLine {
 public:
  /// Keeps the part inside the half-space with an outward normal, where the line's origin is at
  /// `height` [m] above its surface and moves away from it at `rate`.
  void clip(const Vector3d& normal, double height, double rate) {
    if (rate < 0.0) {
      const double t = height / -rate;
      if (t > part_.enter) part_.enter = t, part_.normal = normal;
    } else if (rate > 0.0) {
      part_.exit = std::min(part_.exit, -height / rate);
    } else if (height >= 0.0) {
      part_.exit = -kInfinity;
    }
  }
  std::optional<LinePart> part() const {
    if (!(part_.enter < part_.exit)) return std::nullopt;
    return part_;
  }

 private:
  LinePart part_{-kInfinity, kInfinity, Vector3d::UnitZ()};
};

/// A chord of a circle or sphere around 0 by the line p + t d with d unit: its middle is at t =
/// −p·d, and half its length is √(r² − q²), with q the distance of the line from 0.
struct Chord {
  double middle, half;  ///< half < 0: the line passes outside

  template <class Vector>
  Chord(const Vector& p, const Vector& d, double radius) : middle(-p.dot(d)) {
    const double q = (p + middle * d).norm();
    half = q < radius ? std::sqrt((radius - q) * (radius + q)) : -1.0;
  }
};

/// The part of the line p + t d in each shape, in the frame of the shape.
struct PartOfLine {
  Vector3d p, d;

  std::optional<LinePart> operator()(const Point&) const { return std::nullopt; }
  std::optional<LinePart> operator()(const Sphere& sphere) const {
    const Chord chord(p, d, sphere.radius);
    if (!(chord.half > 0.0)) return std::nullopt;
    const double enter = chord.middle - chord.half;
    return LinePart{enter, chord.middle + chord.half, (p + enter * d).normalized()};
  }
  std::optional<LinePart> operator()(const Box& box) const {
    ClippedLine line;
    clip_slabs(0.5 * box.size, 0, &line);
    return line.part();
  }
  std::optional<LinePart> operator()(const Plane&) const {
    ClippedLine line;
    line.clip(Vector3d::UnitZ(), p.z(), d.z());
    return line.part();
  }
  std::optional<LinePart> operator()(const Cylinder& cylinder) const {
    return part_in_cylinder(cylinder.radius, 0.5 * cylinder.length);
  }
  std::optional<LinePart> operator()(const Hull& hull) const {
    ClippedLine line;
    for (const ConvexHull::Face& face : hull.surface->faces())
      line.clip(face.normal, face.normal.dot(p) - face.offset, face.normal.dot(d));
    return line.part();
  }
  // The union of a cylinder and two spheres is convex, so its part of the line reaches from the
  // first entry to the last exit.
  std::optional<LinePart> operator()(const Capsule& capsule) const {
    const Vector3d end(0.0, 0.0, 0.5 * capsule.length);
    std::optional<LinePart> all = part_in_cylinder(capsule.radius, end.z());
    for (const Vector3d& centre : {end, Vector3d(-end)}) {
      const std::optional<LinePart> part = PartOfLine{p - centre, d}(Sphere{capsule.radius});
      if (!part) continue;
      if (!all) all = part;
      all->exit = std::max(all->exit, part->exit);
      if (part->enter < all->enter) all->enter = part->enter, all->normal = part->normal;
    }
    return all;
  }

 private:
  /// Clips by the slabs |x_i| < half_i of the axes from `first` on.
  void clip_slabs(const Vector3d& half, int first, ClippedLine* line) const {
    for (int i = first; i < 3; ++i) {
      line->clip(Vector3d::Unit(i), p[i] - half[i], d[i]);
      line->clip(-Vector3d::Unit(i), -p[i] - half[i], -d[i]);
    }
  }
  std::optional<LinePart> part_in_cylinder(double radius, double half_length) const {
    ClippedLine caps;
    clip_slabs({0.0, 0.0, half_length}, 2, &caps);
    std::optional<LinePart> part = caps.part();
    const Vector2d across = d.head<2>();
    if (across.squaredNorm() < kSmallestSquare)  // along the axis
      return p.head<2>().norm() < radius ? part : std::nullopt;
    const double rate = across.norm();
    const Chord chord(Vector2d(p.head<2>()), Vector2d(across / rate), radius);
    if (!part || !(chord.half > 0.0)) return std::nullopt;
    part->exit = std::min(part->exit, (chord.middle + chord.half) / rate);
    const double enter = (chord.middle - chord.half) / rate;
    if (enter > part->enter) {
      part->enter = enter;
      part->normal << (p + enter * d).head<2>().normalized(), 0.0;
    }
    if (!(part->enter < part->exit)) return std::nullopt;
    return part;
  }
};

}  // namespace

std::optional<LinePart> line_part_in(const Shape& shape, const BodyState& pose,
                                     const Vector3d& origin, const Vector3d& direction) {
  const Eigen::Quaterniond to_shape = pose.orientation.conjugate();
  const Vector3d from_centre = origin - pose.position;
  // The line starts where it is nearest to the centre: coordinates are as small as the shape. A
  // plane has no centre that matters.
  const double shift = std::holds_alternative<Plane>(shape) ? 0.0 : -from_centre.dot(direction);
  const PartOfLine line{to_shape * (from_centre + shift * direction), to_shape * direction};
  std::optional<LinePart> part = visit_convex(line, shape);
  if (part) {
    part->enter += shift;
    part->exit += shift;
    part->normal = pose.orientation * part->normal;
  }
  return part;
}

}  // namespace constraint_sim::engine
