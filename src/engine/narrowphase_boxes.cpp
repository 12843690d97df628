// What touches a box.

#include <algorithm>
#include <array>
#include <cmath>

#include "engine/manifold_points.h"
#include "engine/narrowphase.h"

namespace constraint_sim::engine {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;

/// A box in world coordinates.
struct OrientedBox {
  OrientedBox(const Vector3d& size, const BodyState& state, std::uint32_t first_number = 0)
      : centre(state.position),
        axes(state.orientation.toRotationMatrix()),
        half(0.5 * size),
        first_edge(first_number) {}

  /// Half its width along a unit vector [m].
  double reach(const Vector3d& n) const { return (axes.transpose() * n).cwiseAbs().dot(half); }

  /// From the centre to a side [m].
  Vector3d arm(int axis, bool upper) const {
    return axes.col(axis) * (upper ? half[axis] : -half[axis]);
  }

  /// The number of the edge along `axis` on the given sides of the next axis and the one after.
  std::uint32_t edge(int axis, bool upper_next, bool upper_last) const {
    return first_edge + 4u * static_cast<std::uint32_t>(axis) + (upper_next ? 2u : 0u) +
           (upper_last ? 1u : 0u);
  }

  Vector3d centre;
  Matrix3d axes;             ///< in columns
  Vector3d half;             ///< of the edge lengths [m]
  std::uint32_t first_edge;  ///< the number of its first edge, of twelve
};

constexpr std::uint32_t kEdgesOfBox = 12;

/// Where two edges meet: a vertex of one box, or a point of both. The same whichever comes first.
std::uint32_t crossing(std::uint32_t edge_1, std::uint32_t edge_2) {
  return std::min(edge_1, edge_2) * 2 * kEdgesOfBox + std::max(edge_1, edge_2);
}

/// A direction along which two boxes may be apart.
struct Axis {
  Vector3d normal = Vector3d::Zero();                      ///< unit, from B to A
  double depth = std::numeric_limits<double>::infinity();  ///< how far A is to move out [m]
  int edge_a = -1;  ///< the edges whose cross product it is; -1 where it is a face's normal
  int edge_b = -1;
};

/// Separating axes (Gottschalk, Lin & Manocha 1996): the one of least depth among the normals of
/// the faces and the cross products of edges, or one of depth ≤ 0.
Axis least_axis(const OrientedBox& a, const OrientedBox& b) {
  const Vector3d p_BA = a.centre - b.centre;
  Axis least;
  // whether the boxes are apart along n
  const auto separates = [&](const Vector3d& n, int edge_a, int edge_b) {
    const double distance = n.dot(p_BA);
    const double depth = a.reach(n) + b.reach(n) - std::abs(distance);
    if (depth < least.depth) least = {distance < 0.0 ? -n : n, depth, edge_a, edge_b};
    return !(depth > 0.0);
  };

  for (int i = 0; i < 3; ++i) {
    if (separates(a.axes.col(i), -1, -1)) return least;
    if (separates(b.axes.col(i), -1, -1)) return least;
  }
  for (int i = 0; i < 3; ++i) {
    for (int j = 0; j < 3; ++j) {
      const Vector3d n = a.axes.col(i).cross(b.axes.col(j));
      const double sine = n.norm();
      if (sine < 1e-12) continue;  // parallel edges: the faces' normals see all there is
      if (separates(n / sine, i, j)) return least;
    }
  }
  return least;
}

/// A convex polygon. Each vertex knows the edge that leads on to the next.
struct Polygon {
  struct Vertex {
    Vector3d position;
    std::uint32_t edge = 0;
  };

  void add(const Vector3d& position, std::uint32_t edge) {
    if (count < static_cast<int>(vertices.size())) vertices[count++] = {position, edge};
  }

  int count = 0;
  std::array<Vertex, 8> vertices;  ///< two quadrangles share no more
};

/// The face of a box that looks most against a unit vector, from the box's centre, world axes.
Polygon face_against(const OrientedBox& box, const Vector3d& n) {
  const Vector3d n_box = box.axes.transpose() * n;
  int k = 0;
  n_box.cwiseAbs().maxCoeff(&k);
  const int u = (k + 1) % 3;
  const int v = (k + 2) % 3;
  const bool upper = n_box[k] < 0.0;

  const Vector3d centre = box.arm(k, upper);
  const Vector3d to_u = box.arm(u, true);
  const Vector3d to_v = box.arm(v, true);
  Polygon face;
  face.add(centre - to_u - to_v, box.edge(u, false, upper));
  face.add(centre + to_u - to_v, box.edge(v, upper, true));
  face.add(centre + to_u + to_v, box.edge(u, true, upper));
  face.add(centre - to_u + to_v, box.edge(v, upper, false));
  return face;
}

/// The part of a polygon where side·position[axis] ≤ limit (Sutherland & Hodgman 1974); what bounds
/// it there is `edge`.
Polygon clipped(const Polygon& polygon, int axis, double side, double limit, std::uint32_t edge) {
  Polygon result;
  for (int i = 0; i < polygon.count; ++i) {
    const Polygon::Vertex& from = polygon.vertices[i];
    const Polygon::Vertex& to = polygon.vertices[(i + 1) % polygon.count];
    const double beyond_from = side * from.position[axis] - limit;
    const double beyond_to = side * to.position[axis] - limit;

    if (beyond_from <= 0.0) result.add(from.position, from.edge);
    if ((beyond_from <= 0.0) != (beyond_to <= 0.0)) {
      const double share = beyond_from / (beyond_from - beyond_to);
      result.add(from.position + share * (to.position - from.position),
                 beyond_from <= 0.0 ? edge : from.edge);
    }
  }
  return result;
}

/// Contact of `reference`, by its face across axis k that looks at `other`, with the face of
/// `other` that looks back.
Manifold collide_faces(const OrientedBox& reference, int k, const OrientedBox& other) {
  const bool upper = reference.axes.col(k).dot(other.centre - reference.centre) > 0.0;
  const double side = upper ? 1.0 : -1.0;
  const Vector3d outward = side * reference.axes.col(k);
  const int u = (k + 1) % 3;
  const int v = (k + 2) % 3;

  // the other's face in the frame of the reference
  Polygon polygon = face_against(other, outward);
  for (int i = 0; i < polygon.count; ++i) {
    Vector3d& position = polygon.vertices[i].position;
    position = reference.axes.transpose() * (position + (other.centre - reference.centre));
  }

  // a little wider than it is, the reference keeps the vertices, and so the features, of a face
  // that ends flush with it, whatever the round-off
  const double margin = 1e-6 * std::min(reference.half.minCoeff(), other.half.minCoeff());
  const Vector3d half = reference.half + Vector3d::Constant(margin);
  polygon = clipped(polygon, u, 1.0, half[u], reference.edge(v, upper, true));
  polygon = clipped(polygon, u, -1.0, half[u], reference.edge(v, upper, false));
  polygon = clipped(polygon, v, 1.0, half[v], reference.edge(u, true, upper));
  polygon = clipped(polygon, v, -1.0, half[v], reference.edge(u, false, upper));

  Manifold manifold;
  manifold.normal = -outward;
  for (int i = 0; i < polygon.count; ++i) {
    const Polygon::Vertex& vertex = polygon.vertices[i];
    const Polygon::Vertex& previous = polygon.vertices[(i + polygon.count - 1) % polygon.count];
    add_point(manifold, reference.centre + reference.axes * vertex.position,
              reference.half[k] - side * vertex.position[k], crossing(previous.edge, vertex.edge));
  }
  return manifold;
}

/// An edge of a box.
struct Edge {
  Vector3d arm;  ///< from the box's centre to the edge's, world axes [m]
  std::uint32_t number = 0;
};

/// The edge along axis k that lies farthest along n.
Edge support_edge(const OrientedBox& box, int k, const Vector3d& n) {
  const int u = (k + 1) % 3;
  const int v = (k + 2) % 3;
  const bool upper_u = n.dot(box.axes.col(u)) > 0.0;
  const bool upper_v = n.dot(box.axes.col(v)) > 0.0;
  return {box.arm(u, upper_u) + box.arm(v, upper_v), box.edge(k, upper_u, upper_v)};
}

Manifold collide_edges(const OrientedBox& a, const OrientedBox& b, const Axis& axis) {
  const Edge edge_a = support_edge(a, axis.edge_a, -axis.normal);
  const Edge edge_b = support_edge(b, axis.edge_b, axis.normal);
  const Vector3d along_a = a.axes.col(axis.edge_a);
  const Vector3d along_b = b.axes.col(axis.edge_b);

  // the point of B's edge nearest to the line of A's
  const Vector3d across = along_b - along_b.dot(along_a) * along_a;
  const Vector3d p_BA = (a.centre - b.centre) + edge_a.arm - edge_b.arm;
  const double t = across.dot(p_BA) / across.squaredNorm();
  const Vector3d position = b.centre + edge_b.arm + t * along_b;

  Manifold manifold;
  manifold.normal = axis.normal;
  add_point(manifold, position, axis.depth, crossing(edge_a.number, edge_b.number));
  return manifold;
}

}  // namespace

Manifold collide_box_plane(const Vector3d& size_a, const BodyState& a, const Vector3d& N,
                           double d) {
  const OrientedBox box(size_a, a);
  Manifold manifold;
  manifold.normal = N;
  for (std::uint32_t vertex = 0; vertex < 8; ++vertex) {
    const Vector3d position = box.centre + box.arm(0, (vertex & 1u) != 0) +
                              box.arm(1, (vertex & 2u) != 0) + box.arm(2, (vertex & 4u) != 0);
    const double depth = d - N.dot(position);
    add_point(manifold, position + depth * N, depth, vertex);
  }
  return manifold;
}

Manifold collide_box_sphere(const Vector3d& size_a, const BodyState& a, const Vector3d& p_b,
                            double radius_b) {
  const OrientedBox box(size_a, a);
  const Vector3d centre = box.axes.transpose() * (p_b - box.centre);
  const Vector3d nearest = centre.cwiseMax(-box.half).cwiseMin(box.half);
  const double distance_squared = (nearest - centre).squaredNorm();
  if (distance_squared >= radius_b * radius_b) return {};

  Manifold manifold;
  double depth = 0.0;
  if (distance_squared >= kSmallestSquare) {
    const double distance = std::sqrt(distance_squared);
    manifold.normal = box.axes * (nearest - centre) / distance;
    depth = radius_b - distance;
  } else {
    // the centre is inside: out through the nearest face, the first of them where they tie
    int k = 0;
    const double below_face = (box.half - centre.cwiseAbs()).minCoeff(&k);
    manifold.normal = box.axes.col(k) * (centre[k] < 0.0 ? 1.0 : -1.0);
    depth = radius_b + below_face;
  }
  add_point(manifold, p_b + radius_b * manifold.normal, depth, 0);
  return manifold;
}

Manifold collide_box_box(const Vector3d& size_a, const BodyState& a, const Vector3d& size_b,
                         const BodyState& b) {
  const OrientedBox box_a(size_a, a);
  const OrientedBox box_b(size_b, b, kEdgesOfBox);
  const Axis axis = least_axis(box_a, box_b);
  if (!(axis.depth > 0.0)) return {};

  // The points of a face hold a box more firmly than one crossing of edges. So the face is taken
  // also where the edges' axis is nearly its normal, as it is with boxes that rest on each other.
  constexpr double kFaceCosine = 0.999;
  int face_a = 0;
  int face_b = 0;
  const double cosine_a = (box_a.axes.transpose() * axis.normal).cwiseAbs().maxCoeff(&face_a);
  const double cosine_b = (box_b.axes.transpose() * axis.normal).cwiseAbs().maxCoeff(&face_b);
  if (std::max(cosine_a, cosine_b) < kFaceCosine) return collide_edges(box_a, box_b, axis);

  // A's face where both are parallel, so that round-off cannot switch them and rename the points
  constexpr double kParallel = 1e-6;
  if (cosine_a > cosine_b - kParallel) return collide_faces(box_a, face_a, box_b);
  return swapped(collide_faces(box_b, face_b, box_a));
}

}  // namespace constraint_sim::engine
