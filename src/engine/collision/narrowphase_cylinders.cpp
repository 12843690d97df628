// Contacts of a cylinder. With boxes and cylinders: the axis of least depth, then the features of
// both shapes along this axis, clipped by each other.

#include <algorithm>
#include <array>
#include <cmath>
#include <optional>

#include "engine/collision/least_depth_axis.h"
#include "engine/collision/manifold_points.h"
#include "engine/collision/narrowphase.h"
#include "engine/collision/narrowphase_tolerances.h"
#include "engine/math/elementary.h"
#include "engine/math/numbers.h"

namespace constraint_sim::engine {
namespace {

using Eigen::Vector2d;
using Eigen::Vector3d;

// ---- features

// Codes of features. Box: vertices 0 to 7, edges 8 to 19, faces 20 to 25. Cylinder: points of its
// rims 0 to 15, its side 16, its caps 20 and 21.
constexpr std::uint32_t kFirstEdge = 8, kSide = 16, kFirstFace = 20, kNothing = 31;

/// The extreme part of a solid along a direction: a point, a line or an area.
struct Feature {
  enum class Kind : char { kPoint, kLine, kArea };

  /// A point with the code of the feature that it lies on.
  struct End {
    Vector3d p;
    std::uint32_t code;
  };

  Kind kind = Kind::kPoint;
  End ends[2];                        ///< ends of a line; a point uses the first
  Vector3d centre, u, v;              ///< centre of an area, and unit vectors in it
  Vector3d out;                       ///< unit normal of an area
  double half_u = 0.0, half_v = 0.0;  ///< half edges of a face, or the radius of a cap twice [m]
  bool is_round = false;
  std::uint32_t code = 0;  ///< code of the line or area
};

/// Returns the number of a vertex, 0 to 7, by signs.
std::uint32_t vertex_of(const Vector3d& signs) {
  return (signs.x() > 0.0 ? 1U : 0U) + (signs.y() > 0.0 ? 2U : 0U) + (signs.z() > 0.0 ? 4U : 0U);
}

Feature feature_of_box(const Solid& box, const Vector3d& along) {
  const Vector3d c = box.axes.transpose() * along;
  Vector3d signs;
  for (int i = 0; i < 3; ++i) signs[i] = std::copysign(1.0, c[i]);
  Feature feature;
  Eigen::Index most = 0, least = 0;
  c.cwiseAbs().maxCoeff(&most);
  c.cwiseAbs().minCoeff(&least);
  const Eigen::Index next = (most + 1) % 3, last = (most + 2) % 3;
  if (math::hypot(c[next], c[last]) <= kFlatSine) {
    feature.kind = Feature::Kind::kArea;
    feature.out = signs[most] * box.axes.col(most);
    feature.centre = box.centre + box.half[most] * feature.out;
    feature.u = box.axes.col(next);
    feature.v = box.axes.col(last);
    feature.half_u = box.half[next];
    feature.half_v = box.half[last];
    feature.code =
        kFirstFace + 2U * static_cast<std::uint32_t>(most) + (signs[most] > 0.0 ? 1U : 0U);
    return feature;
  }
  const auto end = [&](double sign) -> Feature::End {
    Vector3d of = signs;
    if (sign != 0.0) of[least] = sign;
    return {box.centre + box.axes * of.cwiseProduct(box.half), vertex_of(of)};
  };
  if (std::abs(c[least]) > kFlatSine) {
    feature.ends[0] = end(0.0);
    return feature;
  }
  feature.kind = Feature::Kind::kLine;
  feature.ends[0] = end(-1.0);
  feature.ends[1] = end(1.0);
  feature.code = kFirstEdge + 4U * static_cast<std::uint32_t>(least) +
                 (signs[(least + 1) % 3] > 0.0 ? 2U : 0U) +
                 (signs[(least + 2) % 3] > 0.0 ? 1U : 0U);
  return feature;
}

/// Returns the code of a point of a rim. `quarter` counts quarter turns from the lowest point, or
/// from the x axis of a level cap.
std::uint32_t rim_code(bool is_upper, bool is_level, int quarter) {
  return (is_upper ? 8U : 0U) + (is_level ? 4U : 0U) + static_cast<std::uint32_t>(quarter);
}

Feature feature_of_cylinder(const Solid& cylinder, const Vector3d& along) {
  const Vector3d c = cylinder.axes.transpose() * along;
  const double across = math::hypot(c.x(), c.y());
  const double side = std::copysign(1.0, c.z());
  Feature feature;
  if (across <= kFlatSine) {
    feature.kind = Feature::Kind::kArea;
    feature.is_round = true;
    feature.out = side * cylinder.axis();
    feature.centre = cylinder.centre + cylinder.half.z() * feature.out;
    feature.u = cylinder.axes.col(0);
    feature.v = cylinder.axes.col(1);
    feature.half_u = feature.half_v = cylinder.radius();
    feature.code = kFirstFace + (side > 0.0 ? 1U : 0U);
    return feature;
  }
  const Vector3d radial = cylinder.axes.leftCols<2>() * (cylinder.radius() / across * c.head<2>());
  const auto end = [&](double upper) -> Feature::End {
    return {cylinder.centre + radial + upper * cylinder.half.z() * cylinder.axis(),
            rim_code(upper > 0.0, false, 0)};
  };
  if (std::abs(c.z()) > kFlatSine) {
    feature.ends[0] = end(side);
    return feature;
  }
  feature.kind = Feature::Kind::kLine;
  feature.ends[0] = end(-1.0);
  feature.ends[1] = end(1.0);
  feature.code = kSide;
  return feature;
}

Feature feature_of(const Solid& solid, const Vector3d& along) {
  return solid.is_round ? feature_of_cylinder(solid, along) : feature_of_box(solid, along);
}

/// Returns four points of the rim of a cap, at quarter turns from the lowest point against `up`, or
/// along the body's axes for a level cap.
std::array<Feature::End, 4> rim_of(const Feature& cap, const Vector3d& up) {
  Vector3d down = -(cap.u * cap.u.dot(up) + cap.v * cap.v.dot(up));
  const double sine = down.norm();
  const bool is_level = sine < kLevelSine;
  down = is_level ? cap.u : Vector3d(down / sine);
  const Vector3d beside = cap.u.cross(cap.v).cross(down);
  const bool is_upper = cap.code == kFirstFace + 1U;
  std::array<Feature::End, 4> rim;
  const Vector3d arms[] = {down, beside, -down, -beside};
  for (int k = 0; k < 4; ++k)
    rim[k] = {cap.centre + cap.half_u * arms[k], rim_code(is_upper, is_level, k)};
  return rim;
}

/// Returns the projection along n of a point on an area, relative to its centre, along its u and v.
Vector2d over(const Feature& area, const Vector3d& n, const Vector3d& p) {
  const Vector3d d = p - area.centre;
  const Vector3d in = d - n * (area.out.dot(d) / area.out.dot(n));
  return {area.u.dot(in), area.v.dot(in)};
}

bool is_over(const Feature& area, const Vector3d& n, const Vector3d& p) {
  const Vector2d x = over(area, n, p);
  if (area.is_round) return x.norm() <= area.half_u * (1.0 + kWiderShare);
  return std::abs(x.x()) <= area.half_u * (1.0 + kWiderShare) &&
         std::abs(x.y()) <= area.half_v * (1.0 + kWiderShare);
}

/// Part of a line that lies over an area.
struct Part {
  double from = 0.0, to = 1.0;                             ///< shares of the line
  std::uint32_t from_edge = kNothing, to_edge = kNothing;  ///< edges of the area that cut the line
};

std::optional<Part> part_over(const Feature& area, const Vector3d& n, const Vector3d& p_0,
                              const Vector3d& p_1) {
  const Vector2d x = over(area, n, p_0);
  const Vector2d d = over(area, n, p_1) - x;
  Part part;
  const auto cut = [&](double from, double to, std::uint32_t from_edge, std::uint32_t to_edge) {
    if (from > part.from) part.from = from, part.from_edge = from_edge;
    if (to < part.to) part.to = to, part.to_edge = to_edge;
  };
  if (area.is_round) {
    const double radius = area.half_u * (1.0 + kWiderShare);
    const double a = d.squaredNorm(), b = x.dot(d), c = x.squaredNorm() - radius * radius;
    const double root = b * b - a * c;
    if (!(root >= 0.0) || a == 0.0) return std::nullopt;
    // Root formula without cancellation.
    const double most = -b - std::copysign(std::sqrt(root), b);
    const double s_0 = most / a, s_1 = most == 0.0 ? 0.0 : c / most;
    cut(std::min(s_0, s_1), std::max(s_0, s_1), 0, 1);
  } else {
    for (int i = 0; i < 2; ++i) {
      const double half = (i == 0 ? area.half_u : area.half_v) * (1.0 + kWiderShare);
      const auto edge = static_cast<std::uint32_t>(2 * i);
      if (d[i] == 0.0) {
        if (std::abs(x[i]) > half) return std::nullopt;
        continue;
      }
      const double s_0 = (-half - x[i]) / d[i], s_1 = (half - x[i]) / d[i];
      if (d[i] > 0.0)
        cut(s_0, s_1, edge, edge + 1U);
      else
        cut(s_1, s_0, edge + 1U, edge);
    }
  }
  if (part.from > part.to) return std::nullopt;
  return part;
}

// ---- points

/// Collects the contact points of the features of A and B.
class Meeting {
 public:
  Meeting(const Solid& a, const Solid& b, const Vector3d& origin, const LeastDepthAxis& axes,
          double margin)
      : a_(feature_of(a, -axes.normal())),
        b_(feature_of(b, axes.normal())),
        origin_(origin),
        margin_(margin) {
    manifold_.normal = axes.normal();
    if (a_.kind == Kind::kArea && b_.kind == Kind::kArea)
      meet_areas();
    else if (a_.kind == Kind::kArea && b_.kind == Kind::kLine)
      meet_line_and_area(b_, a_);
    else if (a_.kind == Kind::kLine && b_.kind == Kind::kArea)
      meet_line_and_area(a_, b_);
    else if (a_.kind == Kind::kLine && b_.kind == Kind::kLine)
      meet_lines();
  }

  /// Adds the extreme point of A or B, for point features and features that do not overlap.
  void add_farthest(const Solid& b, const LeastDepthAxis& axes) {
    const Vector3d on_b = a_.kind == Kind::kPoint
                              ? Vector3d(a_.ends[0].p + axes.depth() * axes.normal())
                              : Vector3d(b.centre + b.farthest(axes.normal()));
    add_point(manifold_, origin_ + on_b, axes.depth(),
              code(a_.kind == Kind::kPoint ? a_.ends[0].code : a_.code,
                   b_.kind == Kind::kPoint ? b_.ends[0].code : b_.code, kNothing),
              margin_);
  }

  const Manifold& manifold() const { return manifold_; }

 private:
  using Kind = Feature::Kind;

  static std::uint32_t code(std::uint32_t a, std::uint32_t b, std::uint32_t edge) {
    return (a * 32U + b) * 32U + edge;
  }

  void add(const Vector3d& on_a, const Vector3d& on_b, std::uint32_t feature) {
    add_point(manifold_, origin_ + on_b, manifold_.normal.dot(on_b - on_a), feature, margin_);
  }

  // Adds a point of one shape against an area of the other, along the normal.
  void add_over(const Feature& area, const Vector3d& p, std::uint32_t feature) {
    const Vector3d& n = manifold_.normal;
    const Vector3d there = p - n * (area.out.dot(p - area.centre) / area.out.dot(n));
    if (&area == &b_)
      add(p, there, feature);
    else
      add(there, p, feature);
  }

  // Adds the part of a line over an area. Without `with_end` an uncut second end is left to the
  // next line of a polygon.
  void add_part(const Feature::End (&ends)[2], std::uint32_t line, const Feature& area,
                bool with_end) {
    const auto part = part_over(area, manifold_.normal, ends[0].p, ends[1].p);
    if (!part) return;
    const Vector3d along = ends[1].p - ends[0].p;
    const bool is_cut = part->from_edge != kNothing;
    add_over(area, ends[0].p + part->from * along,
             code(is_cut ? line : ends[0].code, area.code, part->from_edge));
    if (part->to_edge != kNothing)
      add_over(area, ends[0].p + part->to * along, code(line, area.code, part->to_edge));
    else if (with_end)
      add_over(area, ends[1].p, code(ends[1].code, area.code, kNothing));
  }

  void meet_line_and_area(const Feature& line, const Feature& area) {
    add_part(line.ends, line.code, area, true);
  }

  void meet_lines() {
    const Vector3d& n = manifold_.normal;
    const Vector3d d_a = a_.ends[1].p - a_.ends[0].p, d_b = b_.ends[1].p - b_.ends[0].p;
    const double length_a = d_a.norm();
    const double cross = n.dot(d_a.cross(d_b));
    const Vector3d from = b_.ends[0].p - a_.ends[0].p;
    if (std::abs(cross) > kFlatSine * length_a * d_b.norm()) {
      const double s_a = n.dot(from.cross(d_b)) / cross, s_b = n.dot(from.cross(d_a)) / cross;
      if (s_a < 0.0 || s_a > 1.0 || s_b < 0.0 || s_b > 1.0) return;
      add(a_.ends[0].p + s_a * d_a, b_.ends[0].p + s_b * d_b, code(a_.code, b_.code, kNothing));
      return;
    }
    // Nearly parallel lines: the ends of each line beside the other line.
    const auto add_beside = [&](const Feature& of, const Feature& line) {
      const Vector3d d = line.ends[1].p - line.ends[0].p;
      for (const Feature::End& end : of.ends) {
        const double s = d.dot(end.p - line.ends[0].p) / d.squaredNorm();
        if (s < -kWiderShare || s > 1.0 + kWiderShare || manifold_.count == 2) continue;
        const Vector3d beside = line.ends[0].p + s * d;
        if (&of == &a_)
          add(end.p, beside, code(end.code, b_.code, kNothing));
        else
          add(beside, end.p, code(a_.code, end.code, kNothing));
      }
    };
    add_beside(a_, b_);
    add_beside(b_, a_);
  }

  // Adds the contact of areas: B is a cap, A a face or a cap.
  void meet_areas() {
    const Vector3d& n = manifold_.normal;
    if (a_.is_round) {
      meet_rims();
    } else {
      const Vector3d u = a_.half_u * a_.u, v = a_.half_v * a_.v;
      const Vector3d corners[] = {a_.centre - u - v, a_.centre + u - v, a_.centre + u + v,
                                  a_.centre - u + v};
      for (std::uint32_t k = 0; k < 4; ++k)
        add_part({{corners[k], k}, {corners[(k + 1U) % 4U], (k + 1U) % 4U}}, kFirstEdge + k, b_,
                 false);
    }
    for (const Feature::End& end : rim_of(b_, a_.out))
      if (is_over(a_, n, end.p)) add_over(a_, end.p, code(a_.code, end.code, kNothing));
    if (!a_.is_round) return;
    for (const Feature::End& end : rim_of(a_, b_.out))
      if (is_over(b_, n, end.p)) add_over(b_, end.p, code(end.code, b_.code, kNothing));
  }

  // Adds the crossings of the rims of two caps, projected along the normal, which is a normal of a
  // cap.
  void meet_rims() {
    const Vector2d x = over(b_, manifold_.normal, a_.centre);
    const double distance = x.norm(), r_a = a_.half_u, r_b = b_.half_u;
    if (distance <= std::abs(r_a - r_b) || distance >= r_a + r_b) return;
    const double along = 0.5 * (distance + (r_b - r_a) * (r_b + r_a) / distance);
    const double beside = std::sqrt(std::max(0.0, (r_b - along) * (r_b + along)));
    const Vector2d e = x / distance;
    for (const double sign : {-1.0, 1.0}) {
      const Vector2d y(along * e.x() - sign * beside * e.y(),
                       along * e.y() + sign * beside * e.x());
      add_over(a_, b_.centre + b_.u * y.x() + b_.v * y.y(),
               code(a_.code, b_.code, sign > 0.0 ? 1U : 0U));
    }
  }

  Feature a_, b_;
  Vector3d origin_;
  double margin_;
  Manifold manifold_;
};

Manifold collide(const Solid& a, const Solid& b, const Vector3d& origin, double margin) {
  LeastDepthAxis axes(a, b);
  axes.find(margin);
  if (!(axes.depth() > -margin)) return {};
  LeastDepthAxis of_face = axes;
  of_face.take_face();
  const Meeting of_faces(a, b, origin, of_face, margin);
  if (of_faces.manifold().count > 0) return of_faces.manifold();
  Meeting meeting(a, b, origin, axes, margin);
  if (meeting.manifold().count == 0) meeting.add_farthest(b, axes);
  return meeting.manifold();
}

Separation separation(const Solid& a, const Solid& b) {
  LeastDepthAxis axes(a, b);
  axes.find(kInfinity);
  return {axes.normal(), -axes.depth()};
}

}  // namespace

Manifold Collide::operator()(const Cylinder& cylinder_a, const Plane&) const {
  const Vector3d N = normal_of_plane(b);
  const double d = N.dot(b.position);
  const Solid cylinder(cylinder_a, a, Vector3d::Zero());
  const double cosine = N.dot(cylinder.axis());
  const int lower = cosine > 0.0 ? -1 : 1;
  const double across = (N - cosine * cylinder.axis()).norm();
  Manifold manifold;
  manifold.normal = N;
  const auto add = [&](const Feature::End& end) {
    const double depth = d - N.dot(end.p);
    add_point(manifold, end.p + depth * N, depth, end.code, margin);
  };
  for (const int side : {lower, -lower}) {
    Feature cap;
    cap.centre = cylinder.cap_centre(side);
    cap.u = cylinder.axes.col(0);
    cap.v = cylinder.axes.col(1);
    cap.half_u = cylinder.radius();
    cap.code = kFirstFace + (side > 0 ? 1U : 0U);
    const auto rim = rim_of(cap, N);
    const std::size_t count = side == lower ? rim.size() : (across < kLevelSine ? 0U : 1U);
    for (std::size_t k = 0; k < count; ++k) add(rim[k]);
  }
  return manifold;
}

Manifold Collide::operator()(const Cylinder& cylinder_a, const Sphere& sphere_b) const {
  const Solid cylinder(cylinder_a, a, Vector3d::Zero());
  const Vector3d centre = cylinder.axes.transpose() * (b.position - cylinder.centre);
  const double across = math::hypot(centre.x(), centre.y());
  const double r = cylinder.radius(), half = cylinder.half.z();
  const Vector3d radial =
      across > 0.0 ? Vector3d(centre.x() / across, centre.y() / across, 0.0) : Vector3d::UnitX();
  Vector3d nearest = std::min(across, r) * radial;
  nearest.z() = std::clamp(centre.z(), -half, half);
  const Vector3d d = nearest - Vector3d(across * radial.x(), across * radial.y(), centre.z());
  const double distance_squared = d.squaredNorm();
  if (distance_squared >= (sphere_b.radius + margin) * (sphere_b.radius + margin)) return {};

  Manifold manifold;
  double depth = 0.0;
  if (distance_squared >= kSmallestSquare) {
    const double distance = std::sqrt(distance_squared);
    manifold.normal = cylinder.axes * d / distance;
    depth = sphere_b.radius - distance;
  } else {  // centre inside: leaves through the nearest of side and caps, on a tie the side
    const double below_side = r - across, below_cap = half - std::abs(centre.z());
    const bool by_side = below_side <= below_cap;
    manifold.normal = by_side ? Vector3d(-(cylinder.axes * radial))
                              : Vector3d(centre.z() < 0.0 ? cylinder.axis() : -cylinder.axis());
    depth = sphere_b.radius + std::min(below_side, below_cap);
  }
  add_point(manifold, b.position + sphere_b.radius * manifold.normal, depth, 0, margin);
  return manifold;
}

Manifold Collide::operator()(const Box& box_a, const Cylinder& cylinder_b) const {
  return collide(Solid(box_a.size, a, b.position), Solid(cylinder_b, b, b.position), b.position,
                 margin);
}

Manifold Collide::operator()(const Cylinder& cylinder_a, const Cylinder& cylinder_b) const {
  return collide(Solid(cylinder_a, a, b.position), Solid(cylinder_b, b, b.position), b.position,
                 margin);
}

Separation Separate::operator()(const Box& box_a, const Cylinder& cylinder_b) const {
  return separation(Solid(box_a.size, a, b.position), Solid(cylinder_b, b, b.position));
}

Separation Separate::operator()(const Cylinder& cylinder_a, const Cylinder& cylinder_b) const {
  return separation(Solid(cylinder_a, a, b.position), Solid(cylinder_b, b, b.position));
}

Separation Separate::operator()(const Cylinder& cylinder_a, const Plane&) const {
  const Vector3d N = normal_of_plane(b);
  const double d = N.dot(b.position);
  const Solid cylinder(cylinder_a, a, Vector3d::Zero());
  return {N, N.dot(a.position) - d - cylinder.support_extent(N)};
}

}  // namespace constraint_sim::engine
