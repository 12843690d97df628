// Contacts of a capsule with boxes and hulls.

#include <algorithm>
#include <cmath>
#include <optional>

#include "engine/collision/capsule_points.h"
#include "engine/collision/narrowphase.h"
#include "engine/collision/narrowphase_tolerances.h"

namespace constraint_sim::engine {
namespace {

using Eigen::Vector3d;

// ---- boxes and hulls

/// Search for the axis of least depth of a line that crosses a polytope.
class CrossedPolytope {
 public:
  CrossedPolytope(const Segment& line, const Polytope& b)
      : line_(line), b_(b), size_(line.half + b.radius) {
    least_.gap = -kInfinity;
  }

  LineGap find() {
    for (int i = 0; i < b_.faces(); ++i) {
      const Vector3d n = b_.normal(i);
      const double depth = b_.extent_of_face(i) + line_.support_extent(-n);
      const Vector3d end = line_.vertex(line_.farthest(-n));
      if (is_less(depth)) take(n, depth, end + depth * n, b_.vertices() + b_.edges() + i);
    }
    for (int i = 0; i < b_.edges(); ++i) try_edge(i);
    return least_;
  }

 private:
  bool is_less(double depth) const { return depth < -least_.gap - kTieShare * size_; }
  void take(const Vector3d& n, double depth, const Vector3d& on_b, int feature) {
    least_ = {n, -depth, on_b, kMiddle * kEndCode + static_cast<std::uint32_t>(feature)};
  }
  // Tries the common normal of the line and an edge, if it lies between the normals of both faces.
  void try_edge(int number) {
    const ConvexHull::Edge& edge = b_.edge(number);
    const Vector3d left = b_.normal(edge.left), right = b_.normal(edge.right);
    if (left.dot(line_.axis) * right.dot(line_.axis) > 0.0) return;
    const Vector3d from = b_.vertex(edge.from), direction = b_.direction(number);
    const Vector3d cross = direction.cross(line_.axis);
    const double length = cross.norm();
    if (!(length > kParallelSine * direction.norm())) return;
    const Vector3d n = cross / (cross.dot(left + right) < 0.0 ? -length : length);
    const double depth = n.dot(from - line_.centre);
    if (!is_less(depth)) return;
    const double t =
        n.dot((line_.centre - from).cross(line_.axis)) / n.dot(direction.cross(line_.axis));
    take(n, depth, from + std::clamp(t, 0.0, 1.0) * direction, b_.vertices() + number);
  }

  const Segment& line_;
  const Polytope& b_;
  double size_;
  LineGap least_;
};

LineGap gap_of(const Segment& line, const Polytope& b, double margin) {
  const NearestPoints nearest = nearest_points(line, b, margin);
  LineGap found;
  if (nearest.is_beyond) return found;
  if (nearest.distance <= kTouchingShare * (line.half + b.radius))
    return CrossedPolytope(line, b).find();
  found.normal = (nearest.on_a - nearest.on_b).normalized();
  found.gap = nearest.distance;
  found.on_b = nearest.on_b;
  found.feature = kMiddle * kEndCode + static_cast<std::uint32_t>(nearest.vertex_b);
  return found;
}

/// Returns the part of a line over a face, seen along the normal of the face.
std::optional<PlaceRange> line_over_face(const Segment& line, const Polytope& b, int number) {
  const ConvexHull::Face& face = b.face(number);
  const Vector3d N = b.normal(number);
  PlaceRange part{-line.half, line.half};
  for (int k = 0; k < face.count; ++k) {
    const Vector3d from = b.vertex(b.corner(face, k).vertex);
    const Vector3d to = b.vertex(b.corner(face, (k + 1) % face.count).vertex);
    const Vector3d out = (to - from).cross(N).normalized();
    const double beyond = out.dot(line.centre - from) - kWiderShare * b.radius;
    const double rate = out.dot(line.axis);
    if (rate == 0.0 && beyond > 0.0) return std::nullopt;
    if (rate > 0.0) part.to = std::min(part.to, -beyond / rate);
    if (rate < 0.0) part.from = std::max(part.from, -beyond / rate);
  }
  if (part.from > part.to) return std::nullopt;
  return part;
}

/// Returns the edge at the vertex farthest along n that is parallel to the line; -1 if there is
/// none.
int parallel_edge(const Segment& line, const Polytope& b, const Vector3d& n) {
  const int vertex = b.farthest(n);
  for (int i = 0; i < b.edges(); ++i) {
    if (b.edge(i).from != vertex && b.edge(i).to != vertex) continue;
    const Vector3d direction = b.direction(i);
    if (direction.cross(line.axis).norm() <= kAlongSine * direction.norm()) return i;
  }
  return -1;
}

Manifold collide_line_polytope(const Segment& line, double radius, const Polytope& b,
                               const Vector3d& origin, double margin) {
  const auto add_feature = [&](const Vector3d& n) {
    const int face = b.nearest_face(n);
    const Vector3d N = b.normal(face);
    const bool is_on_face = n.dot(N) >= kFaceCosine;
    CapsulePoints points(line, radius, is_on_face ? N : n, origin, margin);
    if (is_on_face) {
      const double level = b.extent_of_face(face);
      if (const std::optional<PlaceRange> part = line_over_face(line, b, face))
        points.add_ends(*part, static_cast<std::uint32_t>(b.vertices() + b.edges() + face),
                        [&](const Vector3d& p) -> Vector3d { return p + (level - N.dot(p)) * N; });
    } else if (const int edge = parallel_edge(line, b, n); edge >= 0) {
      const Vector3d from = b.vertex(b.edge(edge).from), direction = b.direction(edge);
      if (const std::optional<PlaceRange> part = line_beside(line, from, from + direction))
        points.add_ends(*part, static_cast<std::uint32_t>(b.vertices() + edge),
                        [&](const Vector3d& p) -> Vector3d {
                          return from +
                                 direction * (direction.dot(p - from) / direction.squaredNorm());
                        });
    }
    return points;
  };
  return contact_of_capsule(line, radius, gap_of(line, b, margin + radius), origin, margin,
                            add_feature);
}

}  // namespace

Manifold Collide::operator()(const Capsule& capsule_a, const Box& box_b) const {
  return collide_line_polytope(middle_line(capsule_a, a, b.position), capsule_a.radius,
                               Polytope(box_b.size, b, b.position), b.position, margin);
}

Manifold Collide::operator()(const Capsule& capsule_a, const Hull& hull_b) const {
  return collide_line_polytope(middle_line(capsule_a, a, b.position), capsule_a.radius,
                               Polytope(hull_b, b, b.position), b.position, margin);
}

Separation Separate::operator()(const Capsule& capsule_a, const Box& box_b) const {
  const LineGap found =
      gap_of(middle_line(capsule_a, a, b.position), Polytope(box_b.size, b, b.position), kInfinity);
  return {found.normal, found.gap - capsule_a.radius};
}

Separation Separate::operator()(const Capsule& capsule_a, const Hull& hull_b) const {
  const LineGap found =
      gap_of(middle_line(capsule_a, a, b.position), Polytope(hull_b, b, b.position), kInfinity);
  return {found.normal, found.gap - capsule_a.radius};
}

}  // namespace constraint_sim::engine
