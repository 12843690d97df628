// Contact of two boxes: separating axes in the frame of the first box, then the face of one box
// clipped by the face of the other, or the crossing of two edges.

#include <algorithm>
#include <array>
#include <cmath>

#include "engine/collision/manifold_points.h"
#include "engine/collision/narrowphase.h"
#include "engine/collision/narrowphase_tolerances.h"
#include "engine/math/numbers.h"

namespace constraint_sim::engine {
namespace {

using Eigen::Matrix3d;
using Eigen::Quaterniond;
using Eigen::Vector3d;

/// Cyclic successor and predecessor of an axis.
constexpr int next(int i) { return i == 2 ? 0 : i + 1; }
constexpr int last(int i) { return i == 0 ? 2 : i - 1; }

/// Two boxes in the frame of the first.
struct BoxPair {
  BoxPair(const Vector3d& size_a, const BodyState& a, const Vector3d& size_b, const BodyState& b)
      : half_a(0.5 * size_a), half_b(0.5 * size_b) {
    const Quaterniond to_a = a.orientation.conjugate();
    C = (to_a * b.orientation).toRotationMatrix();
    t = to_a * (b.position - a.position);
  }

  Vector3d half_a, half_b;  ///< half edge lengths [m]
  Matrix3d C;               ///< B's axes in columns
  Vector3d t;               ///< B's centre [m]
};

// ---- separating axes

/// A possible separating direction of two boxes: the normal of a face of A or of B, or the cross
/// product of an edge of each.
struct Axis {
  double depth = kInfinity;  ///< distance by which A has to move out [m]
  int a = -1;                ///< axis of A's face or edge
  int b = -1;                ///< axis of B's face or edge

  bool is_of_edges() const { return a >= 0 && b >= 0; }
};

/// Returns the face of least depth; ties go to the first of a_0, b_0, a_1, b_1, a_2, b_2.
Axis least_face(const BoxPair& pair, double margin) {
  const auto& [h_a, h_b, C, t] = pair;
  double of_a[3];
  double of_b[3];
  for (int i = 0; i < 3; ++i) {
    of_a[i] =
        h_a[i] +
        (std::abs(C(i, 0)) * h_b[0] + std::abs(C(i, 1)) * h_b[1] + std::abs(C(i, 2)) * h_b[2]) -
        std::abs(t[i]);
    of_b[i] =
        h_b[i] +
        (std::abs(C(0, i)) * h_a[0] + std::abs(C(1, i)) * h_a[1] + std::abs(C(2, i)) * h_a[2]) -
        std::abs(C(0, i) * t[0] + C(1, i) * t[1] + C(2, i) * t[2]);
  }
  Axis least;
  least.depth = std::min(
      {std::min(of_a[0], of_b[0]), std::min(of_a[1], of_b[1]), std::min(of_a[2], of_b[2])});
  if (!(least.depth > -margin)) return least;
  for (int i = 2; i >= 0; --i) {
    if (of_b[i] == least.depth) least.a = -1, least.b = i;
    if (of_a[i] == least.depth) least.a = i, least.b = -1;
  }
  return least;
}

/// Returns a_i × b_j in the frame of A.
Vector3d edge_axis(const BoxPair& pair, int i, int j) {
  Vector3d n = Vector3d::Zero();
  n[next(i)] = -pair.C(last(i), j);
  n[last(i)] = pair.C(next(i), j);
  return n;
}

/// Returns the depth along the cross product of nearly parallel edges [m]. The product has lost
/// digits, so both boxes are projected on the direction as computed, which never underestimates the
/// depth.
double depth_of_flat_edges(const BoxPair& pair, int i, int j) {
  constexpr double kLeastEdgeSine = 1e-12;  // below, face normals suffice
  const Vector3d cross = edge_axis(pair, i, j);
  const double sine = cross.norm();
  if (sine < kLeastEdgeSine) return kInfinity;
  const Vector3d n = cross / sine;
  return n.cwiseAbs().dot(pair.half_a) + (pair.C.transpose() * n).cwiseAbs().dot(pair.half_b) -
         std::abs(n.dot(pair.t));
}

/// Returns the separating axis (Gottschalk, Lin & Manocha 1996) of least depth, or any of depth ≤
/// −margin; the first on ties.
[[gnu::always_inline]] inline Axis least_axis(const BoxPair& pair, double margin) {
  // Squared sine below which rounding exceeds 1e-12 of the size.
  constexpr double kFlatSquare = 1e-8;
  constexpr double kOverlapRounding = 16.0 * kEpsilon;  // share of the size
  const auto& [h_a, h_b, C, t] = pair;
  Axis least = least_face(pair, margin);
  if (!(least.depth > -margin)) return least;

  // Depths along cross products of edges are overlaps over sines. Candidates are found without
  // square roots, with an allowance for rounding of the overlap.
  const double rounding = kOverlapRounding * (h_a.sum() + h_b.sum() + t.cwiseAbs().sum());
  const double most = least.depth * std::abs(least.depth);
  std::array<double, 9> overlaps;
  std::array<double, 9> squares;
  unsigned candidates = 0;
  for (int i = 0; i < 3; ++i) {
    const int u = next(i);
    const int v = last(i);
    for (int j = 0; j < 3; ++j) {
      const int k = 3 * i + j;
      squares[k] = C(u, j) * C(u, j) + C(v, j) * C(v, j);
      overlaps[k] =
          (h_a[u] * std::abs(C(v, j)) + h_a[v] * std::abs(C(u, j)) +
           h_b[next(j)] * std::abs(C(i, last(j))) + h_b[last(j)] * std::abs(C(i, next(j)))) -
          std::abs(t[v] * C(u, j) - t[u] * C(v, j));
      const double least_overlap = overlaps[k] - rounding;
      const bool may_be_less = least_overlap * std::abs(least_overlap) < most * squares[k];
      candidates |= (may_be_less ? 1u : 0u) << k;
    }
  }
  for (int k = 0; candidates != 0; ++k, candidates >>= 1) {
    if ((candidates & 1u) == 0) continue;
    const double depth = squares[k] < kFlatSquare ? depth_of_flat_edges(pair, k / 3, k % 3)
                                                  : overlaps[k] / std::sqrt(squares[k]);
    if (depth < least.depth) least = {depth, k / 3, k % 3};
  }
  return least;
}

// ---- features

constexpr std::uint32_t kEdgesOfBox = 12;

/// Returns the number of the edge along `axis` on the given sides of the next and the last axis.
std::uint32_t edge_number(int axis, bool upper_next, bool upper_last) {
  return 4u * static_cast<std::uint32_t>(axis) + (upper_next ? 2u : 0u) + (upper_last ? 1u : 0u);
}

/// Returns the feature of a point on two edges: a vertex of a box, or the crossing of an edge of
/// each. Symmetric in its arguments.
std::uint32_t crossing(std::uint32_t edge_1, std::uint32_t edge_2) {
  return std::min(edge_1, edge_2) * 2 * kEdgesOfBox + std::max(edge_1, edge_2);
}

// ---- contact of faces

/// A convex polygon over the face of a box, in coordinates along the axes next and last to the
/// face's axis, and along that axis. Each vertex has the number of the edge to the next vertex.
struct Polygon {
  void add(double x, double y, double z, std::uint32_t edge) {
    if (count == kMostCorners) return;
    coordinates[0][count] = x;
    coordinates[1][count] = y;
    coordinates[2][count] = z;
    edges[count++] = edge;
  }

  static constexpr int kMostCorners = 8;  ///< two quadrangles share no more vertices
  int count = 0;
  double coordinates[3][kMostCorners];  ///< coordinates of the vertices [m]
  std::uint32_t edges[kMostCorners];
};

/// The other box in the coordinates of a face.
struct OverFace {
  OverFace(const BoxPair& pair, int k, bool is_of_b) {
    const Vector3d& half = is_of_b ? pair.half_a : pair.half_b;
    const int axes[] = {next(k), last(k), k};
    for (int i = 0; i < 3; ++i) {
      const int axis = axes[i];
      for (int j = 0; j < 3; ++j) cosines[i][j] = is_of_b ? pair.C(j, axis) : pair.C(axis, j);
      for (int j = 0; j < 3; ++j) arms[i][j] = cosines[i][j] * half[j];
      centre[i] = is_of_b ? -pair.C.col(axis).dot(pair.t) : pair.t[axis];
    }
  }

  double cosines[3][3];  ///< cosines of the box's axes, in columns
  double arms[3][3];     ///< arms from the centre to the upper sides, in columns [m]
  double centre[3];      ///< centre of the box [m]
};

/// A face of the other box, with its half widths along the axes of the reference face.
struct UpperFace : Polygon {
  /// Takes the face whose normal is most opposed to the reference face.
  UpperFace(const OverFace& box, double side, std::uint32_t first_edge) {
    const auto& cosines = box.cosines[2];
    int j = std::abs(cosines[1]) > std::abs(cosines[0]) ? 1 : 0;
    if (std::abs(cosines[2]) > std::abs(cosines[j])) j = 2;
    const bool upper = side * cosines[j] < 0.0;
    const int u = next(j);
    const int v = last(j);
    for (int i = 0; i < 3; ++i) {
      const double middle = box.centre[i] + (upper ? box.arms[i][j] : -box.arms[i][j]);
      const double to_u = box.arms[i][u];
      const double to_v = box.arms[i][v];
      coordinates[i][0] = middle - to_u - to_v;
      coordinates[i][1] = middle + to_u - to_v;
      coordinates[i][2] = middle + to_u + to_v;
      coordinates[i][3] = middle - to_u + to_v;
      half_width[i] = std::abs(to_u) + std::abs(to_v);
      centre[i] = middle;
    }
    edges[0] = first_edge + edge_number(u, false, upper);
    edges[1] = first_edge + edge_number(v, upper, true);
    edges[2] = first_edge + edge_number(u, true, upper);
    edges[3] = first_edge + edge_number(v, upper, false);
    count = 4;
  }

  double centre[3];      ///< centre of the face [m]
  double half_width[3];  ///< half widths [m]
};

/// Writes the part of a polygon where side·coordinate ≤ limit (Sutherland & Hodgman 1974); the new
/// boundary has the number `edge`.
template <int kAxis>
void clip(const Polygon& polygon, double side, double limit, std::uint32_t edge, Polygon* part) {
  const auto& [x, y, z] = polygon.coordinates;
  const double(&along)[Polygon::kMostCorners] = polygon.coordinates[kAxis];
  part->count = 0;
  double beyond = side * along[0] - limit;
  for (int i = 0; i < polygon.count; ++i) {
    const int to = i + 1 == polygon.count ? 0 : i + 1;
    const double beyond_next = side * along[to] - limit;
    const bool is_within = beyond <= 0.0;
    if (is_within) part->add(x[i], y[i], z[i], polygon.edges[i]);
    if (is_within != (beyond_next <= 0.0)) {
      const double share = beyond / (beyond - beyond_next);
      part->add(x[i] + share * (x[to] - x[i]), y[i] + share * (y[to] - y[i]),
                z[i] + share * (z[to] - z[i]), is_within ? edge : polygon.edges[i]);
    }
    beyond = beyond_next;
  }
}

/// Adds the contact of the reference face, across axis k, with the face of the other box that is
/// opposed to it.
void collide_faces(const BoxPair& pair, int k, const BodyState& reference, bool is_of_b,
                   double margin, Manifold* manifold) {
  const OverFace other(pair, k, is_of_b);
  const Vector3d& half = is_of_b ? pair.half_b : pair.half_a;
  const bool upper = other.centre[2] > 0.0;
  const double side = upper ? 1.0 : -1.0;
  const int u = next(k);
  const int v = last(k);
  const std::uint32_t first_edge = is_of_b ? kEdgesOfBox : 0;
  const UpperFace face(other, side, kEdgesOfBox - first_edge);

  const double wider = kWiderShare * std::min(pair.half_a.minCoeff(), pair.half_b.minCoeff());
  const double most_u = half[u] + wider;
  const double most_v = half[v] + wider;
  std::array<Polygon, 2> parts;
  const Polygon* polygon = &face;
  const auto clip_by = [&](auto axis, double end, double most, std::uint32_t edge) {
    constexpr int kAxis = decltype(axis)::value;
    if (end * face.centre[kAxis] + face.half_width[kAxis] <= most) return;
    Polygon* const part = polygon == &parts[0] ? &parts[1] : &parts[0];
    clip<kAxis>(*polygon, end, most, first_edge + edge, part);
    polygon = part;
  };
  const std::integral_constant<int, 0> along_u;
  const std::integral_constant<int, 1> along_v;
  clip_by(along_u, 1.0, most_u, edge_number(v, upper, true));
  clip_by(along_u, -1.0, most_u, edge_number(v, upper, false));
  clip_by(along_v, 1.0, most_v, edge_number(u, true, upper));
  clip_by(along_v, -1.0, most_v, edge_number(u, false, upper));

  const Matrix3d R = reference.orientation.toRotationMatrix();
  const double level = side * half[k];
  manifold->normal = (is_of_b ? side : -side) * R.col(k);
  const auto& [x, y, z] = polygon->coordinates;
  std::uint32_t previous = polygon->edges[polygon->count == 0 ? 0 : polygon->count - 1];
  for (int i = 0; i < polygon->count; ++i) {
    const double height = is_of_b ? level : z[i];  // position on the surface of B
    add_point(*manifold,
              reference.position + (x[i] * R.col(u) + y[i] * R.col(v) + height * R.col(k)),
              side * (level - z[i]), crossing(previous, polygon->edges[i]), margin);
    previous = polygon->edges[i];
  }
}

// ---- contact of edges

/// An edge of a box.
struct SupportEdge {
  Vector3d arm;  ///< arm from the box's centre to the edge's middle [m]
  std::uint32_t number = 0;
};

/// Returns the edge along axis k that lies farthest along n, in the frame of the box.
SupportEdge support_edge(const Vector3d& half, int k, const Vector3d& n) {
  const bool upper_next = n[next(k)] > 0.0;
  const bool upper_last = n[last(k)] > 0.0;
  Vector3d arm = Vector3d::Zero();
  arm[next(k)] = upper_next ? half[next(k)] : -half[next(k)];
  arm[last(k)] = upper_last ? half[last(k)] : -half[last(k)];
  return {arm, edge_number(k, upper_next, upper_last)};
}

/// Adds the contact of the edges farthest along their cross product; none for separated boxes whose
/// edges do not cross.
void collide_edges(const BoxPair& pair, const Axis& axis, const BodyState& a, double margin,
                   Manifold* manifold) {
  // Scalar arithmetic, since vector loads would wait for the scalar stores before them.
  const auto& [h_a, h_b, C, t] = pair;
  const int i = axis.a, u = next(i), v = last(i);
  const int j = axis.b, k = next(j), l = last(j);
  double n_u = -C(v, j), n_v = C(u, j);  // cross product along A's axes u and v
  const double square = n_u * n_u + n_v * n_v;
  const double sine = n_u * t[u] + n_v * t[v] > 0.0 ? -std::sqrt(square) : std::sqrt(square);
  n_u /= sine;
  n_v /= sine;
  const bool upper_u = n_u < 0.0, upper_v = n_v < 0.0;
  const bool upper_k = C(u, k) * n_u + C(v, k) * n_v > 0.0;
  const bool upper_l = C(u, l) * n_u + C(v, l) * n_v > 0.0;
  const double arm_u = upper_u ? h_a[u] : -h_a[u], arm_v = upper_v ? h_a[v] : -h_a[v];
  const double arm_k = upper_k ? h_b[k] : -h_b[k], arm_l = upper_l ? h_b[l] : -h_b[l];
  const auto middle = [&, &C = C, &t = t](int x) {
    return t[x] + (C(x, k) * arm_k + C(x, l) * arm_l);
  };

  // Point of B's edge nearest to the line of A's edge.
  const double m_i = middle(i), m_u = middle(u), m_v = middle(v);
  const double s = (C(u, j) * (arm_u - m_u) + C(v, j) * (arm_v - m_v)) / square;
  const double s_a = m_i + s * C(i, j);
  const bool cross = std::abs(s) <= h_b[j] && std::abs(s_a) <= h_a[i];
  if (axis.depth < 0.0 && !cross) return;

  const Matrix3d R = a.orientation.toRotationMatrix();
  manifold->normal = n_u * R.col(u) + n_v * R.col(v);
  Vector3d p;
  p[i] = s_a;
  p[u] = m_u + s * C(u, j);
  p[v] = m_v + s * C(v, j);
  add_point(
      *manifold, a.position + R * p, axis.depth,
      crossing(edge_number(i, upper_u, upper_v), kEdgesOfBox + edge_number(j, upper_k, upper_l)),
      margin);
}

// ---- separated boxes whose nearest features are neither a face nor crossing edges

/// Nearest points of two boxes so far, with their squared distance.
struct Nearest {
  Vector3d on_a, on_b;
  std::uint32_t feature = 0;
  double square = kInfinity;

  void lower(const Vector3d& p_a, const Vector3d& p_b, std::uint32_t of) {
    const double other = (p_a - p_b).squaredNorm();
    if (other < square) *this = {p_a, p_b, of, other};
  }
};

/// Returns a vertex of a box relative to its centre.
Vector3d vertex(const Vector3d& half, std::uint32_t i) {
  return {(i & 1u) != 0 ? half[0] : -half[0], (i & 2u) != 0 ? half[1] : -half[1],
          (i & 4u) != 0 ? half[2] : -half[2]};
}

/// Compares the nearest points of an edge of A and an edge of B (Ericson 2005, 5.1.9). Ends of
/// edges are compared as vertices.
void lower_by_edges(const BoxPair& pair, int i, const SupportEdge& of_a, int j,
                    const SupportEdge& of_b, Nearest* nearest) {
  const Vector3d along_b = pair.C.col(j);
  const Vector3d middle_b = pair.t + pair.C * of_b.arm;
  Vector3d across = along_b;
  across[i] = 0.0;
  const double square = across.squaredNorm();
  if (square < kSmallestSquare) return;
  const double s = across.dot(of_a.arm - middle_b) / square;
  const Vector3d p_b = middle_b + s * along_b;
  if (!(std::abs(s) < pair.half_b[j]) || !(std::abs(p_b[i]) < pair.half_a[i])) return;
  Vector3d p_a = of_a.arm;
  p_a[i] = p_b[i];
  nearest->lower(p_a, p_b, crossing(of_a.number, kEdgesOfBox + of_b.number));
}

/// Returns the nearest points of two separated boxes, among all vertices and edges.
[[gnu::noinline, gnu::cold]] Nearest nearest_points(const BoxPair& pair) {
  // Features of vertices, numbered after the features of edge pairs.
  constexpr std::uint32_t kVerticesOfA = 4 * kEdgesOfBox * kEdgesOfBox;
  constexpr std::uint32_t kVerticesOfB = kVerticesOfA + 8;
  const Matrix3d to_b = pair.C.transpose();
  Nearest nearest;
  for (std::uint32_t i = 0; i < 8; ++i) {
    const Vector3d p_a = vertex(pair.half_a, i);
    const Vector3d in_b = (to_b * (p_a - pair.t)).cwiseMax(-pair.half_b).cwiseMin(pair.half_b);
    nearest.lower(p_a, pair.t + pair.C * in_b, kVerticesOfA + i);
    const Vector3d p_b = pair.t + pair.C * vertex(pair.half_b, i);
    nearest.lower(p_b.cwiseMax(-pair.half_a).cwiseMin(pair.half_a), p_b, kVerticesOfB + i);
  }
  const auto edge = [](const Vector3d& half, int k, unsigned corner) {
    Vector3d sides = Vector3d::Zero();
    sides[next(k)] = (corner & 2u) != 0 ? 1.0 : -1.0;
    sides[last(k)] = (corner & 1u) != 0 ? 1.0 : -1.0;
    return support_edge(half, k, sides);
  };
  for (int i = 0; i < 3; ++i)
    for (int j = 0; j < 3; ++j)
      for (unsigned corners = 0; corners < 16; ++corners)
        lower_by_edges(pair, i, edge(pair.half_a, i, corners & 3u), j,
                       edge(pair.half_b, j, corners >> 2), &nearest);
  return nearest;
}

/// Replaces the points of separated boxes by one, of their nearest points, if that is closer.
/// `apart`: lower bound of their distance [m].
void take_nearest(const BoxPair& pair, const BodyState& a, double apart, double margin,
                  Manifold* manifold) {
  double least = margin;
  for (int i = 0; i < manifold->count; ++i)
    least = std::min(least, -manifold->points[static_cast<std::size_t>(i)].depth);
  if (manifold->count > 0 && least <= apart + kCloserShare * margin) return;
  const Nearest nearest = nearest_points(pair);
  const double gap = std::sqrt(nearest.square);
  if (!(gap < least) || nearest.square < kSmallestSquare) return;
  if (manifold->count > 0 && least <= gap + kCloserShare * margin) return;
  manifold->count = 0;
  const Matrix3d R = a.orientation.toRotationMatrix();
  manifold->normal = R * ((nearest.on_a - nearest.on_b) / gap);
  add_point(*manifold, a.position + R * nearest.on_b, -gap, nearest.feature, margin);
}

// ---- choice of the contact

/// Faces of A and of B whose normals are nearest to an axis, with the cosines.
struct NearestFaces {
  NearestFaces(const BoxPair& pair, const Axis& axis) : a(axis.a), b(axis.b) {
    const Matrix3d& C = pair.C;
    if (axis.is_of_edges()) {
      const double n_u = std::abs(C(last(a), b));  // cross product along A's axes
      const double n_v = std::abs(C(next(a), b));
      const double m_u = std::abs(C(a, last(b)));  // cross product along B's axes
      const double m_v = std::abs(C(a, next(b)));
      const double sine = std::sqrt(n_u * n_u + n_v * n_v);
      cosine_a = std::max(n_u, n_v) / sine;
      cosine_b = std::max(m_u, m_v) / sine;
      a = n_u > n_v ? next(a) : last(a);
      b = m_u > m_v ? next(b) : last(b);
    } else if (axis.a < 0) {
      for (int i = 0; i < 3; ++i)
        if (a < 0 || std::abs(C(i, b)) > std::abs(C(a, b))) a = i;
      cosine_a = std::abs(C(a, b));
    }
  }

  int a, b;
  double cosine_a = 1.0, cosine_b = 1.0;
};

}  // namespace

Separation separation_of_boxes(const Vector3d& size_a, const BodyState& a, const Vector3d& size_b,
                               const BodyState& b) {
  const BoxPair pair(size_a, a, size_b, b);
  const Axis axis = least_axis(pair, kInfinity);
  Vector3d n;
  if (axis.is_of_edges())
    n = edge_axis(pair, axis.a, axis.b).normalized();
  else if (axis.a >= 0)
    n = Vector3d::Unit(axis.a);
  else
    n = pair.C.col(axis.b);
  if (n.dot(pair.t) > 0.0) n = -n;
  return {a.orientation * n, -axis.depth};
}

Separation Separate::operator()(const Box& box_a, const Box& box_b) const {
  return separation_of_boxes(box_a.size, a, box_b.size, b);
}

Manifold Collide::operator()(const Box& box_a, const Box& box_b) const {
  const BoxPair pair(box_a.size, a, box_b.size, b);
  const Axis axis = least_axis(pair, margin);
  Manifold manifold;
  if (!(axis.depth > -margin)) return manifold;

  // A face contact with several points holds a box more firmly than a crossing of edges. The face
  // is also taken where the axis of the edges is nearly its normal, as with boxes at rest on each
  // other.
  const NearestFaces faces(pair, axis);
  if (std::max(faces.cosine_a, faces.cosine_b) < kFaceCosine)
    collide_edges(pair, axis, a, margin, &manifold);
  else if (axis.b < 0 || faces.cosine_a > faces.cosine_b - kBothParallel)
    collide_faces(pair, faces.a, a, false, margin, &manifold);
  else
    collide_faces(pair, faces.b, b, true, margin, &manifold);
  if (axis.depth < 0.0) take_nearest(pair, a, -axis.depth, margin, &manifold);
  return manifold;
}

}  // namespace constraint_sim::engine
