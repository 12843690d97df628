// Contacts of a convex hull and a cylinder: the axis of least depth, then the features of both
// shapes along this axis, clipped by each other.

#include <algorithm>
#include <array>
#include <cmath>
#include <optional>

#include "engine/collision/least_depth_axis.h"
#include "engine/collision/manifold_points.h"
#include "engine/collision/narrowphase.h"
#include "engine/collision/narrowphase_tolerances.h"
#include "engine/collision/point_choice.h"
#include "engine/collision/polytope.h"
#include "engine/math/elementary.h"
#include "engine/math/numbers.h"

namespace constraint_sim::engine {
namespace {

using Eigen::Vector3d;

/// Search for the axis of least depth of a hull A and a cylinder B, whose centre is the origin. The
/// depth along the outward direction m of A is m·v + reach_B(m), where v is the vertex of A that is
/// farthest along m.
class HullCylinderAxis {
 public:
  HullCylinderAxis(const Polytope& a, const Solid& b)
      : a_(a), b_(b), size_(a.radius + b.half.sum() + a.centre.norm()) {}

  const Vector3d& normal() const { return normal_; }  ///< unit, from B to A
  double depth() const { return depth_; }

  void find() {
    for (int i = 0; i < a_.faces(); ++i) {
      const Vector3d m = a_.normal(i);
      take(m, a_.extent_of_face(i) + b_.support_extent(m));
    }
    for (const double side : {1.0, -1.0}) try_direction(side * b_.axis());
    for (int i = 0; i < a_.vertices(); ++i) find_at_vertex(a_.vertex(i));
    for (int i = 0; i < a_.edges(); ++i) find_at_edge(i);
  }

 private:
  void take(const Vector3d& m, double depth) {
    if (!(depth < depth_ - kTieShare * size_)) return;
    depth_ = depth;
    normal_ = -m;
  }
  void try_direction(const Vector3d& m) { take(m, a_.support_extent(m) + b_.support_extent(m)); }
  // Tries a direction whose depth is at least the depth of a vertex of A.
  void try_at(const Vector3d& m, const Vector3d& vertex) {
    if (m.dot(vertex) + b_.support_extent(m) < depth_) try_direction(m);
  }

  // Tries a vertex against the side and the rims of B.
  void find_at_vertex(const Vector3d& vertex) {
    const Vector3d p = b_.axes.transpose() * vertex;
    const double across = math::hypot(p.x(), p.y());
    if (across == 0.0) return;
    const Vector3d radial(p.x() / across, p.y() / across, 0.0);
    try_at(b_.axes * -radial, vertex);
    const double beyond = std::abs(p.z()) - b_.half.z();
    if (across <= b_.radius() || beyond <= 0.0) return;
    const Vector3d to_rim =
        (across - b_.radius()) * radial + Vector3d(0.0, 0.0, std::copysign(beyond, p.z()));
    try_at(b_.axes * -to_rim.normalized(), vertex);
  }

  // Tries the arc of an edge on the Gauss map, m = cos θ p + sin θ q from one face to the other.
  void find_at_edge(int number) {
    const ConvexHull::Edge& edge = a_.edge(number);
    const Vector3d p = a_.normal(edge.left), to = a_.normal(edge.right);
    const Vector3d vertex = a_.vertex(edge.from);
    const Vector3d beside = to - p * p.dot(to);
    const double sine = beside.norm(), cosine = p.dot(to);
    if (!(sine > 0.0)) return;
    const Vector3d q = beside / sine;
    const double angle = math::atan2(sine, cosine);
    const int steps = std::max(2, static_cast<int>(24.0 * angle / kPi) + 1);
    const double step = angle / steps;
    const auto direction = [&](double theta) -> Vector3d {
      const auto [s, c] = math::sin_cos(theta);
      return c * p + s * q;
    };
    const auto slope = [&](double theta) {
      const auto [sine_of, cosine_of] = math::sin_cos(theta);
      const Vector3d m = cosine_of * p + sine_of * q;
      return (cosine_of * q - sine_of * p).dot(vertex + b_.farthest(m));
    };
    double falls = slope(0.0);
    for (int k = 0; k < steps; ++k) {
      double low = k * step, high = (k + 1) * step;
      const double rises = slope(high);
      if (falls < 0.0 && rises > 0.0) {
        for (int i = 0; i < kMostBisections && high - low > kAngleRounding; ++i) {
          const double middle = 0.5 * (low + high);
          (slope(middle) > 0.0 ? high : low) = middle;
        }
        try_at(direction(0.5 * (low + high)), vertex);
      }
      falls = rises;
    }
  }

  const Polytope& a_;
  const Solid& b_;
  double size_;
  Vector3d normal_ = Vector3d::UnitZ();
  double depth_ = kInfinity;
};

/// Relative rounding of a cosine, within which a normal counts as within kFlatSine.
constexpr double kCosineRounding = 1e-12;
// Codes of features of the cylinder: its side, caps and points of rims. Features of the hull are
// numbered after them: vertices, edges and faces.
constexpr std::uint32_t kSideLine = 0, kCap = 1, kRim = 3, kCodes = 32;

/// Collects the contact points of a hull A and a cylinder B along an axis.
class HullCylinderPoints {
 public:
  HullCylinderPoints(const Polytope& a, const Solid& b, const Vector3d& n, const Vector3d& origin,
                     double margin)
      : a_(a), b_(b), n_(n), origin_(origin), points_(n, margin) {}

  /// Adds the points of both features, unless these do not overlap.
  void meet() {
    const int face = a_.nearest_face(-n_);
    const double cosine_b = n_.dot(b_.axis());
    const bool is_face = (n_ + a_.normal(face)).norm() <= kFlatSine;
    const bool is_cap = std::sqrt(std::max(0.0, 1.0 - cosine_b * cosine_b)) <= kFlatSine;
    const bool is_side = std::abs(cosine_b) <= kFlatSine;
    cap_ = cosine_b > 0.0 ? 1 : -1;
    if (is_face && is_cap)
      meet_face_and_cap(face);
    else if (is_face && is_side)
      meet_face_and_side(face);
    else if (is_cap)
      meet_edge_and_cap();
    else if (is_side)
      meet_edge_and_side();
  }

  bool is_empty() const { return points_.is_empty(); }

  /// Adds the extreme point of A or B.
  void add_extreme(double depth) {
    const int vertex = a_.farthest(-n_);
    const Vector3d p = a_.vertex(vertex);
    const Vector3d at_b = b_.centre + b_.farthest(n_);
    const int face = a_.nearest_face(-n_);
    const bool is_face = (n_ + a_.normal(face)).norm() <= kFlatSine;
    points_.add(origin_ + (is_face ? at_b : Vector3d(p + depth * n_)), depth,
                code(kRim, is_face ? face_code(face) : static_cast<std::uint32_t>(vertex)));
  }

  Manifold manifold() {
    const Vector3d& beside = b_.axes.col(std::abs(n_.dot(b_.axes.col(0))) < 0.8 ? 0 : 1);
    const Vector3d u = (beside - n_ * n_.dot(beside)).normalized();
    return points_.manifold(u, n_.cross(u));
  }

 private:
  static std::uint32_t code(std::uint32_t of_b, std::uint32_t of_a) { return of_a * kCodes + of_b; }
  std::uint32_t edge_code(int edge) const {
    return static_cast<std::uint32_t>(a_.vertices() + edge);
  }
  std::uint32_t face_code(int face) const {
    return static_cast<std::uint32_t>(a_.vertices() + a_.edges() + face);
  }
  std::uint32_t cap_code() const { return kCap + (cap_ > 0 ? 1U : 0U); }

  void add(const Vector3d& on_a, const Vector3d& on_b, std::uint32_t feature) {
    points_.add(origin_ + on_b, n_.dot(on_b - on_a), feature);
  }
  // Adds a point of B below or above a face of A, along the normal.
  void add_on_face(int face, const Vector3d& on_b, std::uint32_t feature) {
    const Vector3d N = a_.normal(face);
    add(on_b + n_ * ((a_.extent_of_face(face) - N.dot(on_b)) / N.dot(n_)), on_b, feature);
  }
  // Adds a point of A against the plane of the cap, along the normal.
  void add_on_cap(const Vector3d& on_a, std::uint32_t feature) {
    const Vector3d& k = b_.axis();
    add(on_a, on_a + n_ * (k.dot(b_.cap_centre(cap_) - on_a) / k.dot(n_)), feature);
  }

  /// Part of a line over a face or a cap, with the edges of the face that cut the line.
  struct LinePart {
    double from = 0.0, to = 1.0;
    int from_edge = -1, to_edge = -1;
  };

  // Returns the part of p + t d, 0 ≤ t ≤ 1, that is over a face, seen along the normal.
  std::optional<LinePart> part_over_face(int number, const Vector3d& p, const Vector3d& d) const {
    const ConvexHull::Face& face = a_.face(number);
    const double wider = kWiderShare * a_.radius;
    LinePart part;
    for (int k = 0; k < face.count; ++k) {
      const ConvexHull::Corner& corner = a_.corner(face, k);
      const Vector3d from = a_.vertex(corner.vertex);
      const Vector3d to = a_.vertex(a_.corner(face, (k + 1) % face.count).vertex);
      const Vector3d out = n_.cross(to - from).normalized();  // n points into the face
      const double beyond = out.dot(p - from) - wider, rate = out.dot(d);
      if (rate == 0.0) {
        if (beyond > 0.0) return std::nullopt;
      } else if (const double s = -beyond / rate; rate > 0.0) {
        if (s < part.to) part.to = s, part.to_edge = corner.edge;
      } else if (s > part.from) {
        part.from = s, part.from_edge = corner.edge;
      }
    }
    if (part.from > part.to) return std::nullopt;
    return part;
  }

  // Returns the part of a line over the cap, seen along the normal.
  std::optional<LinePart> part_over_cap(const Vector3d& p, const Vector3d& d) const {
    const Vector3d& k = b_.axis();
    const auto along_cap = [&](const Vector3d& x) -> Vector3d {
      return x - n_ * (k.dot(x) / k.dot(n_));
    };
    const Vector3d x = along_cap(p - b_.cap_centre(cap_)), y = along_cap(d);
    const double radius = b_.radius() * (1.0 + kWiderShare);
    const double a = y.squaredNorm(), b = x.dot(y), c = x.squaredNorm() - radius * radius;
    const double root = b * b - a * c;
    if (!(root >= 0.0) || a == 0.0) return std::nullopt;
    const double most = -b - std::copysign(std::sqrt(root), b);  // without cancellation
    const double s_0 = most / a, s_1 = most == 0.0 ? 0.0 : c / most;
    LinePart part;
    if (std::min(s_0, s_1) > 0.0) part.from = std::min(s_0, s_1), part.from_edge = 0;
    if (std::max(s_0, s_1) < 1.0) part.to = std::max(s_0, s_1), part.to_edge = 0;
    if (part.from > part.to) return std::nullopt;
    return part;
  }

  void meet_face_and_cap(int number) {
    const ConvexHull::Face& face = a_.face(number);
    for (int k = 0; k < face.count; ++k) {
      const ConvexHull::Corner& corner = a_.corner(face, k);
      const Vector3d from = a_.vertex(corner.vertex);
      const Vector3d direction = a_.vertex(a_.corner(face, (k + 1) % face.count).vertex) - from;
      const auto part = part_over_cap(from, direction);
      if (!part) continue;
      if (part->from_edge < 0)
        add_on_cap(from, code(cap_code(), static_cast<std::uint32_t>(corner.vertex)));
      else
        add_on_cap(from + part->from * direction, code(cap_code(), edge_code(corner.edge)));
      if (part->to_edge >= 0)
        add_on_cap(from + part->to * direction, code(cap_code() + 2U, edge_code(corner.edge)));
    }
    // Points of the rim at quarter turns from the lowest point, or along the axes of a level cap.
    const Vector3d N = a_.normal(number);
    const Vector3d in_cap = N - b_.axis() * b_.axis().dot(N);
    const double tilt = in_cap.norm();
    const Vector3d u = tilt < kLevelSine ? Vector3d(b_.axes.col(0)) : Vector3d(-in_cap / tilt);
    const Vector3d v = b_.axis().cross(u);
    const Vector3d arms[] = {u, v, -u, -v};
    for (std::uint32_t k = 0; k < 4; ++k) {
      const Vector3d p = b_.cap_centre(cap_) + b_.radius() * arms[k];
      if (is_over(number, p))
        add_on_face(number, p, code(5U + k + (tilt < kLevelSine ? 4U : 0U), face_code(number)));
    }
  }

  bool is_over(int number, const Vector3d& p) const {
    const auto part = part_over_face(number, p, Vector3d::Zero());
    return part.has_value();
  }

  void meet_face_and_side(int number) {
    const auto [from, direction] = side_line();
    const auto part = part_over_face(number, from, direction);
    if (!part) return;
    const auto feature = [&](int edge, std::uint32_t end) {
      return edge < 0 ? code(kRim + end, face_code(number)) : code(kSideLine, edge_code(edge));
    };
    add_on_face(number, from + part->from * direction, feature(part->from_edge, 0));
    add_on_face(number, from + part->to * direction, feature(part->to_edge, 1));
  }

  void meet_edge_and_cap() {
    const int edge = level_edge();
    if (edge < 0) return;
    const Vector3d from = a_.vertex(a_.edge(edge).from), direction = a_.direction(edge);
    const auto part = part_over_cap(from, direction);
    if (!part) return;
    add_on_cap(from + part->from * direction,
               part->from_edge < 0
                   ? code(cap_code(), static_cast<std::uint32_t>(a_.edge(edge).from))
                   : code(cap_code(), edge_code(edge)));
    add_on_cap(from + part->to * direction,
               part->to_edge < 0 ? code(cap_code(), static_cast<std::uint32_t>(a_.edge(edge).to))
                                 : code(cap_code() + 2U, edge_code(edge)));
  }

  void meet_edge_and_side() {
    const int edge = level_edge();
    if (edge < 0) return;
    const auto [from_b, direction_b] = side_line();
    const Vector3d from_a = a_.vertex(a_.edge(edge).from), direction_a = a_.direction(edge);
    const double cross = n_.dot(direction_a.cross(direction_b));
    const Vector3d apart = from_b - from_a;
    if (std::abs(cross) > kFlatSine * direction_a.norm() * direction_b.norm()) {
      const double s = n_.dot(apart.cross(direction_b)) / cross,
                   t = n_.dot(apart.cross(direction_a)) / cross;
      if (s < 0.0 || s > 1.0 || t < 0.0 || t > 1.0) return;
      add(from_a + s * direction_a, from_b + t * direction_b, code(kSideLine, edge_code(edge)));
      return;
    }
    // Nearly parallel lines: the ends of each line beside the other line.
    for (int end = 0; end < 2; ++end) {
      const Vector3d p = from_a + end * direction_a;
      const double t = direction_b.dot(p - from_b) / direction_b.squaredNorm();
      if (t >= -kWiderShare && t <= 1.0 + kWiderShare)
        add(p, from_b + t * direction_b,
            code(kSideLine,
                 static_cast<std::uint32_t>(end == 0 ? a_.edge(edge).from : a_.edge(edge).to)));
      const Vector3d q = from_b + end * direction_b;
      const double s = direction_a.dot(q - from_a) / direction_a.squaredNorm();
      if (s > kWiderShare && s < 1.0 - kWiderShare)
        add(from_a + s * direction_a, q,
            code(kRim + static_cast<std::uint32_t>(end), edge_code(edge)));
    }
  }

  // Returns the line of the side that is farthest along the normal: its start and its direction.
  std::pair<Vector3d, Vector3d> side_line() const {
    const Vector3d across = n_ - b_.axis() * b_.axis().dot(n_);
    const Vector3d direction = 2.0 * b_.half.z() * b_.axis();
    return {b_.centre + b_.radius() * across.normalized() - 0.5 * direction, direction};
  }

  // Returns the edge at the vertex farthest against the normal that is nearest to a right angle to
  // the normal; -1 if none is level.
  int level_edge() const {
    const int vertex = a_.farthest(-n_);
    const Vector3d local = a_.axes.transpose() * n_;
    int best = -1;
    double least = kFlatSine;
    for (int i = 0; i < a_.edges(); ++i) {
      const ConvexHull::Edge& edge = a_.edge(i);
      if (edge.from != vertex && edge.to != vertex) continue;
      const double sine = std::abs(edge.direction.dot(local)) / edge.direction.norm();
      if (sine < least) least = sine, best = i;
    }
    return best;
  }

  const Polytope& a_;
  const Solid& b_;
  Vector3d n_, origin_;
  int cap_ = 1;
  PointChoice points_;
};

/// Returns the normal of a cap or face within kFlatSine of a normal, else the normal.
Vector3d with_flat_normal(const Polytope& a, const Solid& b, const Vector3d& n) {
  const int face = a.nearest_face(-n);
  const double of_face = -n.dot(a.normal(face)), of_cap = std::abs(n.dot(b.axis()));
  if (std::max(of_face, of_cap) * (1.0 + kCosineRounding) < std::sqrt(1.0 - kFlatSine * kFlatSine))
    return n;
  if (of_face >= of_cap * (1.0 - kLaterFaceShare)) return -a.normal(face);
  return n.dot(b.axis()) < 0.0 ? Vector3d(-b.axis()) : Vector3d(b.axis());
}

}  // namespace

Manifold Collide::operator()(const Hull& hull_a, const Cylinder& cylinder_b) const {
  const Polytope hull(hull_a, a, b.position);
  const Solid cylinder(cylinder_b, b, b.position);
  if (hull.centre.norm() - hull.radius - math::hypot(cylinder.radius(), cylinder.half.z()) >=
      margin)
    return {};
  HullCylinderAxis axis(hull, cylinder);
  axis.find();
  if (!(axis.depth() > -margin)) return {};
  HullCylinderPoints flat(hull, cylinder, with_flat_normal(hull, cylinder, axis.normal()),
                          b.position, margin);
  flat.meet();
  if (!flat.is_empty()) return flat.manifold();
  HullCylinderPoints points(hull, cylinder, axis.normal(), b.position, margin);
  points.meet();
  if (points.is_empty()) points.add_extreme(axis.depth());
  return points.manifold();
}

Separation Separate::operator()(const Hull& hull_a, const Cylinder& cylinder_b) const {
  const Polytope hull(hull_a, a, b.position);
  const Solid cylinder(cylinder_b, b, b.position);
  HullCylinderAxis axis(hull, cylinder);
  axis.find();
  return {axis.normal(), -axis.depth()};
}

}  // namespace constraint_sim::engine
