// Box against box: separating axes in the frame of the first box, then the face of one box clipped
// by the face of the other, or the crossing of two edges.

#include <algorithm>
#include <array>
#include <cmath>

#include "engine/collision/manifold_points.h"
#include "engine/collision/narrowphase.h"
#include "engine/math/numbers.h"

namespace constraint_sim::engine {
namespace {

using Eigen::Matrix3d;
using Eigen::Quaterniond;
using Eigen::Vector3d;

/// The axis after i, and the one before it.
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

  Vector3d half_a, half_b;  ///< of the edge lengths [m]
  Matrix3d C;               ///< B's axes in columns
  Vector3d t;               ///< B's centre [m]
};

// ---- separating axes

/// A direction along which two boxes may be apart: the normal of a face of A or of B, or the cross
/// product of an edge of each.
struct Axis {
  double depth = kInfinity;  ///< how far A is to move out [m]
  int a = -1;                ///< axis of A's face or edge
  int b = -1;                ///< the same of B

  bool is_of_edges() const { return a >= 0 && b >= 0; }
};

/// The face of least depth, the first of a_0, b_0, a_1, b_1, a_2 and b_2 where some tie.
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

/// a_i × b_j in the frame of A.
Vector3d edge_axis(const BoxPair& pair, int i, int j) {
  Vector3d n = Vector3d::Zero();
  n[next(i)] = -pair.C(last(i), j);
  n[last(i)] = pair.C(next(i), j);
  return n;
}

/// How far A is to move out along the cross product of edges that are nearly parallel [m]. The
/// direction has lost digits, so that the reach of both boxes is taken along the direction as it
/// came out, and no axis shows too little.
double depth_of_flat_edges(const BoxPair& pair, int i, int j) {
  constexpr double kParallelSine = 1e-12;  // the faces' normals see all there is
  const Vector3d cross = edge_axis(pair, i, j);
  const double sine = cross.norm();
  if (sine < kParallelSine) return kInfinity;
  const Vector3d n = cross / sine;
  return n.cwiseAbs().dot(pair.half_a) + (pair.C.transpose() * n).cwiseAbs().dot(pair.half_b) -
         std::abs(n.dot(pair.t));
}

/// Separating axes (Gottschalk, Lin & Manocha 1996): the one of least depth, or one of depth
/// ≤ −margin. The first where some tie.
[[gnu::always_inline]] inline Axis least_axis(const BoxPair& pair, double margin) {
  constexpr double kFlatSquare = 1e-8;  // of the sine below which rounding takes 1e-12 of the size
  constexpr double kRounding = 16.0 * kEpsilon;
  const auto& [h_a, h_b, C, t] = pair;
  Axis least = least_face(pair, margin);
  if (!(least.depth > -margin)) return least;

  // depths along cross products of edges are overlaps over sines; without a root for each, and
  // with room for what rounding takes of an overlap: which may be less
  const double rounding = kRounding * (h_a.sum() + h_b.sum() + t.cwiseAbs().sum());
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

/// The number of the edge of a box along `axis` on the given sides of the next axis and the last.
std::uint32_t edge_number(int axis, bool upper_next, bool upper_last) {
  return 4u * static_cast<std::uint32_t>(axis) + (upper_next ? 2u : 0u) + (upper_last ? 1u : 0u);
}

/// Where two edges meet: a vertex of one box, or a point of both. The same whichever comes first.
std::uint32_t crossing(std::uint32_t edge_1, std::uint32_t edge_2) {
  return std::min(edge_1, edge_2) * 2 * kEdgesOfBox + std::max(edge_1, edge_2);
}

// ---- contact of faces

/// A convex polygon over the face of a box, in coordinates along the axes before and after the
/// face's and along its own. Each vertex knows the edge that leads on to the next.
struct Polygon {
  void add(double x, double y, double z, std::uint32_t edge) {
    if (count == kMost) return;
    coordinates[0][count] = x;
    coordinates[1][count] = y;
    coordinates[2][count] = z;
    edges[count++] = edge;
  }

  static constexpr int kMost = 8;  ///< two quadrangles share no more
  int count = 0;
  double coordinates[3][kMost];  ///< [m]
  std::uint32_t edges[kMost];
};

/// The box beyond a face of another one, in the coordinates of that face.
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

  double cosines[3][3];  ///< of the box's axes, in columns
  double arms[3][3];     ///< from its centre to its upper sides, in columns [m]
  double centre[3];      ///< [m]
};

/// A face of the box, and half its width along two axes of the face under it.
struct UpperFace : Polygon {
  /// The face that looks most against the side of the one under it.
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
      reach[i] = std::abs(to_u) + std::abs(to_v);
      centre[i] = middle;
    }
    edges[0] = first_edge + edge_number(u, false, upper);
    edges[1] = first_edge + edge_number(v, upper, true);
    edges[2] = first_edge + edge_number(u, true, upper);
    edges[3] = first_edge + edge_number(v, upper, false);
    count = 4;
  }

  double centre[3];  ///< [m]
  double reach[3];   ///< from the centre [m]
};

/// The part of a polygon where side·coordinate ≤ limit (Sutherland & Hodgman 1974); what bounds it
/// there is `edge`.
template <int kAxis>
void clip(const Polygon& polygon, double side, double limit, std::uint32_t edge, Polygon* part) {
  const auto& [x, y, z] = polygon.coordinates;
  const double(&along)[Polygon::kMost] = polygon.coordinates[kAxis];
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

/// Contact of one box, by its face across axis k that looks at the other, with the face of the
/// other that looks back.
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

  // a little wider than it is, the reference keeps the vertices, and so the features, of a face
  // that ends flush with it, whatever the round-off
  const double wider = 1e-6 * std::min(pair.half_a.minCoeff(), pair.half_b.minCoeff());
  const double most_u = half[u] + wider;
  const double most_v = half[v] + wider;
  std::array<Polygon, 2> parts;
  const Polygon* polygon = &face;
  const auto clip_by = [&](auto axis, double end, double most, std::uint32_t edge) {
    constexpr int kAxis = decltype(axis)::value;
    if (end * face.centre[kAxis] + face.reach[kAxis] <= most) return;
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
    const double height = is_of_b ? level : z[i];  // on the surface of B
    add_point(*manifold,
              reference.position + (x[i] * R.col(u) + y[i] * R.col(v) + height * R.col(k)),
              side * (level - z[i]), crossing(previous, polygon->edges[i]), margin);
    previous = polygon->edges[i];
  }
}

// ---- contact of edges

/// An edge of a box.
struct SupportEdge {
  Vector3d arm;  ///< from the box's centre to the edge's [m]
  std::uint32_t number = 0;
};

/// The edge along axis k that lies farthest along n, which is in the frame of the box.
SupportEdge support_edge(const Vector3d& half, int k, const Vector3d& n) {
  const bool upper_next = n[next(k)] > 0.0;
  const bool upper_last = n[last(k)] > 0.0;
  Vector3d arm = Vector3d::Zero();
  arm[next(k)] = upper_next ? half[next(k)] : -half[next(k)];
  arm[last(k)] = upper_last ? half[last(k)] : -half[last(k)];
  return {arm, edge_number(k, upper_next, upper_last)};
}

/// Contact of the edges that lie farthest along their cross product. None where boxes are apart and
/// the edges do not cross.
void collide_edges(const BoxPair& pair, const Axis& axis, const BodyState& a, double margin,
                   Manifold* manifold) {
  // coefficient by coefficient: packets would wait for what was stored by coefficients before
  const auto& [h_a, h_b, C, t] = pair;
  const int i = axis.a, u = next(i), v = last(i);
  const int j = axis.b, k = next(j), l = last(j);
  double n_u = -C(v, j), n_v = C(u, j);  // the cross product, along A's axes u and v
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

  // the point of B's edge nearest to the line of A's
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

// ---- boxes apart whose nearest features are neither a face nor crossing edges

/// Two points and their distance, squared.
struct Nearest {
  Vector3d on_a, on_b;
  std::uint32_t feature = 0;
  double square = kInfinity;

  void lower(const Vector3d& p_a, const Vector3d& p_b, std::uint32_t of) {
    const double other = (p_a - p_b).squaredNorm();
    if (other < square) *this = {p_a, p_b, of, other};
  }
};

/// A vertex of a box, from its centre.
Vector3d vertex(const Vector3d& half, std::uint32_t i) {
  return {(i & 1u) != 0 ? half[0] : -half[0], (i & 2u) != 0 ? half[1] : -half[1],
          (i & 4u) != 0 ? half[2] : -half[2]};
}

/// The nearest points of an edge of A and an edge of B (Ericson 2005, 5.1.9). The ends are among
/// vertices.
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

/// The nearest points of two boxes apart, among all vertices and edges.
[[gnu::noinline, gnu::cold]] Nearest nearest_points(const BoxPair& pair) {
  // features beyond those of edges that meet
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

/// Where the nearest points of boxes apart are other ones than those found, takes these in their
/// place. `apart`: the least that their distance can be [m].
void take_nearest(const BoxPair& pair, const BodyState& a, double apart, double margin,
                  Manifold* manifold) {
  constexpr double kShare = 0.01;  // of the margin, so that boxes about to rest keep their faces
  double least = margin;
  for (int i = 0; i < manifold->count; ++i)
    least = std::min(least, -manifold->points[static_cast<std::size_t>(i)].depth);
  if (manifold->count > 0 && least <= apart + kShare * margin) return;
  const Nearest nearest = nearest_points(pair);
  const double gap = std::sqrt(nearest.square);
  if (!(gap < least) || nearest.square < kSmallestSquare) return;
  if (manifold->count > 0 && least <= gap + kShare * margin) return;
  manifold->count = 0;
  const Matrix3d R = a.orientation.toRotationMatrix();
  manifold->normal = R * ((nearest.on_a - nearest.on_b) / gap);
  add_point(*manifold, a.position + R * nearest.on_b, -gap, nearest.feature, margin);
}

// ---- which of these

/// The face of A and that of B whose normals are the nearest to an axis, with the cosines.
struct NearestFaces {
  NearestFaces(const BoxPair& pair, const Axis& axis) : a(axis.a), b(axis.b) {
    const Matrix3d& C = pair.C;
    if (axis.is_of_edges()) {
      const double n_u = std::abs(C(last(a), b));  // of the cross product along A's axes
      const double n_v = std::abs(C(next(a), b));
      const double m_u = std::abs(C(a, last(b)));  // and along B's
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

Manifold collide_box_box(const Vector3d& size_a, const BodyState& a, const Vector3d& size_b,
                         const BodyState& b, double margin) {
  const BoxPair pair(size_a, a, size_b, b);
  const Axis axis = least_axis(pair, margin);
  Manifold manifold;
  if (!(axis.depth > -margin)) return manifold;

  // The points of a face hold a box more firmly than one crossing of edges. So the face is taken
  // also where the edges' axis is nearly its normal, as it is with boxes that rest on each other.
  constexpr double kFaceCosine = 0.999;
  // A's face where both are parallel, so that round-off cannot switch them and rename the points
  constexpr double kParallel = 1e-6;
  const NearestFaces faces(pair, axis);
  if (std::max(faces.cosine_a, faces.cosine_b) < kFaceCosine)
    collide_edges(pair, axis, a, margin, &manifold);
  else if (axis.b < 0 || faces.cosine_a > faces.cosine_b - kParallel)
    collide_faces(pair, faces.a, a, false, margin, &manifold);
  else
    collide_faces(pair, faces.b, b, true, margin, &manifold);
  if (axis.depth < 0.0) take_nearest(pair, a, -axis.depth, margin, &manifold);
  return manifold;
}

}  // namespace constraint_sim::engine
