// Contacts of a convex hull with planes, spheres, boxes and hulls. With boxes and hulls: the
// nearest points, or the axis of least depth of shapes that touch or overlap; then the face of one
// shape clipped by the face of the other, or a single point.

#include <algorithm>
#include <array>
#include <cmath>

#include "engine/collision/narrowphase.h"
#include "engine/collision/narrowphase_tolerances.h"
#include "engine/collision/point_choice.h"
#include "engine/collision/polytope.h"

namespace constraint_sim::engine {
namespace {

using Eigen::Vector3d;

// Features of nearest points, beyond the features of edges.
constexpr std::uint32_t kFirstNearest = 0x80000000U;

// ---- axis

/// Axis along which two polytopes touch, with the nearest points where they are apart.
struct ContactAxis {
  PolytopeAxis axis;
  NearestPoints nearest;

  bool is_apart() const { return nearest.distance > 0.0; }
};

ContactAxis contact_axis(const Polytope& a, const Polytope& b, double margin) {
  ContactAxis found;
  found.nearest = nearest_points(a, b, margin);
  if (found.nearest.is_beyond) {
    found.axis.depth = -kInfinity;
    return found;
  }
  if (found.nearest.distance > kTouchingShare * (a.radius + b.radius)) {
    found.axis.normal = (found.nearest.on_a - found.nearest.on_b).normalized();
    found.axis.depth = -found.nearest.distance;
  } else {
    found.nearest.distance = 0.0;
    found.axis = least_axis(a, b);
  }
  return found;
}

// ---- contact of faces

/// A face clipped by another face: each vertex has the number of the edge to the next vertex.
struct ClippedFace {
  struct Vertex {
    Vector3d p;
    std::uint32_t edge;
  };

  void add(const Vector3d& p, std::uint32_t edge) {
    if (count < kMostCutVertices) vertices[count++] = {p, edge};
  }

  static constexpr std::size_t kMostCutVertices = 2 * kMostHullVertices;
  std::size_t count = 0;
  std::array<Vertex, kMostCutVertices> vertices;
};

/// Cuts a face down to out·x ≤ limit (Sutherland & Hodgman 1974), into `part`; the new border has
/// the number `edge`.
void clip(const ClippedFace& face, const Vector3d& out, double limit, std::uint32_t edge,
          ClippedFace* part) {
  part->count = 0;
  for (std::size_t i = 0; i < face.count; ++i) {
    const ClippedFace::Vertex& here = face.vertices[i];
    const ClippedFace::Vertex& next = face.vertices[i + 1 == face.count ? 0 : i + 1];
    const double beyond = out.dot(here.p) - limit, beyond_next = out.dot(next.p) - limit;
    const bool is_within = beyond <= 0.0;
    if (is_within) part->add(here.p, here.edge);
    if (is_within != (beyond_next <= 0.0))
      part->add(here.p + beyond / (beyond - beyond_next) * (next.p - here.p),
                is_within ? edge : here.edge);
  }
}

/// Returns the feature of a point on two edges. Symmetric in its arguments.
std::uint32_t crossing_of(std::uint32_t edge_1, std::uint32_t edge_2) {
  return std::min(edge_1, edge_2) * 0x8000U + std::max(edge_1, edge_2);
}

/// Adds the contact of a face of the reference with the face of the other shape that is opposed to
/// it. Edges of the reference count from `first_edge`, edges of the other shape from `other_edge`.
void collide_faces(const Polytope& reference, int number, std::uint32_t first_edge,
                   const Polytope& other, std::uint32_t other_edge, bool is_of_b,
                   const Vector3d& origin, PointChoice* points) {
  const ConvexHull::Face& face = reference.face(number);
  const Vector3d N = reference.normal(number);
  const ConvexHull::Face& opposed = other.face(other.nearest_face(-N));
  std::array<ClippedFace, 2> parts;
  ClippedFace* polygon = &parts[0];
  ClippedFace* next = &parts[1];
  for (int k = 0; k < opposed.count; ++k) {
    const ConvexHull::Corner& corner = other.corner(opposed, k);
    polygon->add(other.vertex(corner.vertex), other_edge + static_cast<std::uint32_t>(corner.edge));
  }
  const double wider = kWiderShare * std::min(reference.radius, other.radius);
  for (int k = 0; k < face.count && polygon->count > 0; ++k) {
    const ConvexHull::Corner& corner = reference.corner(face, k);
    const Vector3d from = reference.vertex(corner.vertex);
    const Vector3d to = reference.vertex(reference.corner(face, (k + 1) % face.count).vertex);
    const Vector3d out = (to - from).cross(N).normalized();
    clip(*polygon, out, out.dot(from) + wider, first_edge + static_cast<std::uint32_t>(corner.edge),
         next);
    std::swap(polygon, next);
  }
  const double level = reference.extent_of_face(number);
  for (std::size_t i = 0; i < polygon->count; ++i) {
    const auto& [p, edge] = polygon->vertices[i];
    const std::uint32_t previous = polygon->vertices[i == 0 ? polygon->count - 1 : i - 1].edge;
    const double depth = level - N.dot(p);
    points->add(origin + (is_of_b ? Vector3d(p + depth * N) : p), depth,
                crossing_of(previous, edge));
  }
}

// ---- single points

/// Returns the point of edge B that is nearest to the line of edge A.
Vector3d point_on_edge(const Polytope& a, int edge_a, const Polytope& b, int edge_b) {
  const Vector3d d_a = a.direction(edge_a), d_b = b.direction(edge_b);
  const Vector3d from = b.vertex(b.edge(edge_b).from);
  const Vector3d n = d_a.cross(d_b);
  const double t = n.dot((from - a.vertex(a.edge(edge_a).from)).cross(d_a)) / n.squaredNorm();
  return from + std::clamp(t, 0.0, 1.0) * d_b;
}

Manifold single_point(const Polytope& a, const Polytope& b, const ContactAxis& found,
                      const Vector3d& origin, double margin) {
  const auto& [axis, nearest] = found;
  Manifold manifold;
  manifold.normal = axis.normal;
  if (found.is_apart()) {
    add_point(manifold, origin + nearest.on_b, axis.depth,
              kFirstNearest + static_cast<std::uint32_t>(nearest.vertex_a) * 0x8000U +
                  static_cast<std::uint32_t>(nearest.vertex_b),
              margin);
  } else if (axis.edge_a >= 0) {
    add_point(manifold, origin + point_on_edge(a, axis.edge_a, b, axis.edge_b), axis.depth,
              crossing_of(static_cast<std::uint32_t>(axis.edge_a),
                          static_cast<std::uint32_t>(a.edges() + axis.edge_b)),
              margin);
  } else {
    const int vertex = b.farthest(axis.normal);
    add_point(manifold, origin + b.vertex(vertex), axis.depth,
              kFirstNearest + 0x7fffU * 0x8000U + static_cast<std::uint32_t>(vertex), margin);
  }
  return manifold;
}

Manifold collide_polytopes(const Polytope& a, const Polytope& b, const Vector3d& origin,
                           double margin) {
  const ContactAxis found = contact_axis(a, b, margin);
  const Vector3d& n = found.axis.normal;
  if (!(found.axis.depth > -margin)) return {};
  const int face_a = a.nearest_face(-n), face_b = b.nearest_face(n);
  const double cosine_a = -n.dot(a.normal(face_a)), cosine_b = n.dot(b.normal(face_b));
  if (std::max(cosine_a, cosine_b) >= kFaceCosine) {
    const bool is_of_b = !(cosine_a > cosine_b - kBothParallel);
    const Vector3d normal = is_of_b ? b.normal(face_b) : Vector3d(-a.normal(face_a));
    const auto edges_of_a = static_cast<std::uint32_t>(a.edges());
    PointChoice points(normal, margin);
    if (is_of_b)
      collide_faces(b, face_b, edges_of_a, a, 0, true, origin, &points);
    else
      collide_faces(a, face_a, 0, b, edges_of_a, false, origin, &points);
    const bool is_close =
        !found.is_apart() || points.least_gap() <= -found.axis.depth + kCloserShare * margin;
    if (!points.is_empty() && is_close) {
      const Polytope& reference = is_of_b ? b : a;
      const Vector3d u =
          reference.direction(reference.corner(reference.face(is_of_b ? face_b : face_a), 0).edge)
              .normalized();
      return points.manifold(u, normal.cross(u));
    }
  }
  return single_point(a, b, found, origin, margin);
}

Separation separation_of_polytopes(const Polytope& a, const Polytope& b) {
  const ContactAxis found = contact_axis(a, b, kInfinity);
  return {found.axis.normal, -found.axis.depth};
}

// ---- hull and sphere

/// Point of the surface of a hull that is nearest to a point.
struct SurfacePoint {
  Vector3d p = Vector3d::Zero();
  Vector3d normal = Vector3d::UnitZ();  ///< unit, from the surface outward to the point
  double distance = kInfinity;          ///< [m]; negative inside
};

/// Compares the point with the nearest point of an edge.
void lower_by_edge(const Vector3d& from, const Vector3d& direction, const Vector3d& point,
                   SurfacePoint* nearest) {
  const double s = std::clamp(direction.dot(point - from) / direction.squaredNorm(), 0.0, 1.0);
  const Vector3d on = from + s * direction;
  const Vector3d apart = point - on;
  const double square = apart.squaredNorm();
  if (!(square < nearest->distance * nearest->distance) || square < kSmallestSquare) return;
  const double distance = std::sqrt(square);
  *nearest = {on, apart / distance, distance};
}

/// Whether the projection of a point on the plane of a face lies on the face.
bool is_over_face(const ConvexHull& hull, const ConvexHull::Face& face, const Vector3d& point) {
  for (int k = 0; k < face.count; ++k) {
    const auto& [vertex, number] = hull.corners()[static_cast<std::size_t>(face.first + k)];
    const ConvexHull::Edge& edge = hull.edges()[static_cast<std::size_t>(number)];
    const Vector3d direction = edge.from == vertex ? edge.direction : Vector3d(-edge.direction);
    const Vector3d& from = hull.vertices()[static_cast<std::size_t>(vertex)];
    if (direction.cross(face.normal).dot(point - from) > 0.0) return false;
  }
  return true;
}

/// Returns the nearest surface point; from inside through the nearest face, the first on ties.
SurfacePoint nearest_on_surface(const ConvexHull& hull, const Vector3d& point) {
  SurfacePoint nearest;
  double above = -kInfinity;
  const ConvexHull::Face* top = nullptr;
  for (const ConvexHull::Face& face : hull.faces()) {
    const double height = face.normal.dot(point) - face.offset;
    if (height > above) above = height, top = &face;
    if (height > 0.0 && height < nearest.distance && is_over_face(hull, face, point))
      nearest = {point - height * face.normal, face.normal, height};
  }
  if (above <= 0.0) return {point - above * top->normal, top->normal, above};
  for (const ConvexHull::Edge& edge : hull.edges())
    lower_by_edge(hull.vertices()[static_cast<std::size_t>(edge.from)], edge.direction, point,
                  &nearest);
  if (nearest.distance == kInfinity)  // on an edge to rounding
    nearest = {point - above * top->normal, top->normal, above};
  return nearest;
}

}  // namespace

Manifold Collide::operator()(const Hull& hull_a, const Plane&) const {
  const Vector3d N = normal_of_plane(b);
  const double d = N.dot(b.position);
  const Polytope hull(hull_a, a, Vector3d::Zero());
  PointChoice points(N, margin);
  for (int i = 0; i < hull.vertices(); ++i) {
    const Vector3d p = hull.vertex(i);
    const double depth = d - N.dot(p);
    points.add(p + depth * N, depth, static_cast<std::uint32_t>(i));
  }
  const Vector3d beside = hull.axes.col(std::abs(N.dot(hull.axes.col(0))) < 0.8 ? 0 : 1);
  const Vector3d u = (beside - N * N.dot(beside)).normalized();
  return points.manifold(u, N.cross(u));
}

Manifold Collide::operator()(const Hull& hull_a, const Sphere& sphere_b) const {
  const Vector3d apart = b.position - a.position;
  const double radii = hull_a.surface->radius() + sphere_b.radius + margin;
  if (apart.squaredNorm() >= radii * radii) return {};
  const Vector3d centre = a.orientation.conjugate() * apart;
  const SurfacePoint nearest = nearest_on_surface(*hull_a.surface, centre);
  Manifold manifold;
  manifold.normal = a.orientation * -nearest.normal;
  add_point(manifold, b.position + sphere_b.radius * manifold.normal,
            sphere_b.radius - nearest.distance, 0, margin);
  return manifold;
}

Manifold Collide::operator()(const Hull& hull_a, const Hull& hull_b) const {
  return collide_polytopes(Polytope(hull_a, a, b.position), Polytope(hull_b, b, b.position),
                           b.position, margin);
}

Manifold Collide::operator()(const Box& box_a, const Hull& hull_b) const {
  return collide_polytopes(Polytope(box_a.size, a, b.position), Polytope(hull_b, b, b.position),
                           b.position, margin);
}

Separation Separate::operator()(const Hull& hull_a, const Hull& hull_b) const {
  return separation_of_polytopes(Polytope(hull_a, a, b.position), Polytope(hull_b, b, b.position));
}

Separation Separate::operator()(const Box& box_a, const Hull& hull_b) const {
  return separation_of_polytopes(Polytope(box_a.size, a, b.position),
                                 Polytope(hull_b, b, b.position));
}

Separation Separate::operator()(const Hull& hull_a, const Plane&) const {
  const Vector3d N = normal_of_plane(b);
  const double d = N.dot(b.position);
  return {N, -Polytope(hull_a, a, Vector3d::Zero()).support_extent(-N) - d};
}

}  // namespace constraint_sim::engine
