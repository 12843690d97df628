#include "engine/collision/polytope.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <vector>

#include "engine/collision/narrowphase_tolerances.h"
#include "engine/math/numbers.h"

namespace constraint_sim::engine {
namespace {

using Eigen::Vector3d;

const ConvexHull& unit_cube() {
  static const ConvexHull cube = [] {
    std::vector<Vector3d> vertices;
    for (unsigned i = 0; i < 8; ++i)
      vertices.emplace_back((i & 1u) != 0 ? 0.5 : -0.5, (i & 2u) != 0 ? 0.5 : -0.5,
                            (i & 4u) != 0 ? 0.5 : -0.5);
    return ConvexHull(vertices);
  }();
  return cube;
}

// ---- nearest points

/// Volume of a tetrahedron, as a share of the product of three edges, below which it counts as flat
/// and would hold 0 by rounding alone.
constexpr double kFlatVolume = 1e-13;
/// Square of the share of the size below which the distance of nearest points is rounding.
constexpr double kTouchingSquare = 1e-28;
/// Share of a squared distance by which another support must lower it, or the search ends: rounding
/// of the products.
constexpr double kLowerShare = 1e-15;

/// A point of the difference of two polytopes, with the vertices that it comes from.
struct Support {
  Vector3d p = Vector3d::Zero();  ///< vertex of A minus vertex of B [m]
  int a = -1, b = -1;

  bool is_same(const Support& other) const { return a == other.a && b == other.b; }
};

/// A simplex of the difference, with the weights of its point nearest to 0.
class Simplex {
 public:
  void add(const Support& support) { points_[count_++] = support; }
  int count() const { return count_; }
  const Support& operator[](int i) const { return points_[static_cast<std::size_t>(i)]; }
  double weight(int i) const { return weights_[static_cast<std::size_t>(i)]; }

  bool has(const Support& support) const {
    for (int i = 0; i < count_; ++i)
      if ((*this)[i].is_same(support)) return true;
    return false;
  }

  /// Keeps the points of the least face that holds the point nearest to 0, and returns that point.
  Vector3d reduce() {
    double least = kInfinity;
    Vector3d nearest = Vector3d::Zero();
    unsigned best = 0;
    std::array<double, 4> best_weights{};
    for (unsigned subset = 1; subset < (1u << static_cast<unsigned>(count_)); ++subset) {
      std::array<double, 4> weights{};
      if (!weights_of(subset, &weights)) continue;
      Vector3d p = Vector3d::Zero();
      for (std::size_t i = 0; i < 4; ++i)
        if (weights[i] > 0.0) p += weights[i] * points_[i].p;
      const double square = p.squaredNorm();
      if (!(square < least)) continue;
      least = square, nearest = p, best = subset, best_weights = weights;
    }
    int kept = 0;
    for (unsigned i = 0; i < 4; ++i) {
      if ((best & (1u << i)) == 0) continue;
      weights_[static_cast<std::size_t>(kept)] = best_weights[i];
      points_[static_cast<std::size_t>(kept++)] = points_[i];
    }
    count_ = kept;
    return nearest;
  }

 private:
  // Sets the weights of the point nearest to 0 on the plane of a subset; false unless all are
  // positive.
  bool weights_of(unsigned subset, std::array<double, 4>* weights) const {
    std::array<std::size_t, 4> of{};
    std::size_t n = 0;
    for (std::size_t i = 0; i < 4; ++i)
      if ((subset & (1u << i)) != 0) of[n++] = i;
    const auto p = [&](std::size_t i) -> const Vector3d& { return points_[of[i]].p; };
    std::array<double, 4> found{};
    if (n == 1) {
      found[0] = 1.0;
    } else if (n == 2) {
      const Vector3d d = p(1) - p(0);
      const double square = d.squaredNorm();
      if (!(square > 0.0)) return false;
      found[1] = -p(0).dot(d) / square;
      found[0] = p(1).dot(d) / square;
    } else if (n == 3) {
      const Vector3d normal = (p(1) - p(0)).cross(p(2) - p(0));
      const double square = normal.squaredNorm();
      if (!(square > 0.0)) return false;
      for (std::size_t i = 0; i < 3; ++i)
        found[i] = normal.dot(p((i + 1) % 3).cross(p((i + 2) % 3))) / square;
    } else {
      const Vector3d d_1 = p(1) - p(0), d_2 = p(2) - p(0), d_3 = p(3) - p(0);
      const double volume = d_1.dot(d_2.cross(d_3));
      if (!(std::abs(volume) > kFlatVolume * d_1.norm() * d_2.norm() * d_3.norm())) return false;
      found[0] = p(1).dot(p(2).cross(p(3))) / volume;
      found[1] = -p(2).dot(p(3).cross(p(0))) / volume;
      found[2] = p(3).dot(p(0).cross(p(1))) / volume;
      found[3] = -p(0).dot(p(1).cross(p(2))) / volume;
    }
    for (std::size_t i = 0; i < n; ++i) {
      if (!(found[i] > 0.0)) return false;
      (*weights)[of[i]] = found[i];
    }
    return true;
  }

  std::array<Support, 4> points_;
  std::array<double, 4> weights_{};
  int count_ = 0;
};

template <class A>
Support support_of(const A& a, const Polytope& b, const Vector3d& direction) {
  Support support;
  support.a = a.farthest(direction);
  support.b = b.farthest(-direction);
  support.p = a.vertex(support.a) - b.vertex(support.b);
  return support;
}

/// Returns the nearest points of a vertex shape and a polytope (GJK). `size`: sum of both sizes
/// [m], to which rounding is relative.
template <class A>
NearestPoints nearest_of(const A& a, const Polytope& b, double size, double margin) {
  constexpr int kMostGjkSteps = 200;  // bounds the run time
  Simplex simplex;
  Vector3d v = a.centre - b.centre;
  if (v.isZero(0.0)) v = Vector3d::UnitZ();
  simplex.add(support_of(a, b, -v));
  v = simplex.reduce();
  NearestPoints nearest;
  for (int step = 0; step < kMostGjkSteps; ++step) {
    const double square = v.squaredNorm();
    if (!(square > kTouchingSquare * size * size) || simplex.count() == 4) {
      nearest.distance = 0.0;
      return nearest;
    }
    const Support next = support_of(a, b, -v);
    const double along = v.dot(next.p);
    if (along > 0.0 && along * along >= margin * margin * square) {
      nearest.is_beyond = true;
      return nearest;
    }
    if (simplex.has(next) || square - along <= kLowerShare * square) break;
    const Simplex before = simplex;
    simplex.add(next);
    const Vector3d better = simplex.reduce();
    if (simplex.count() < 4 && !(better.squaredNorm() < square)) {
      simplex = before;
      break;
    }
    v = better;
  }
  nearest.on_a = nearest.on_b = Vector3d::Zero();
  nearest.vertex_a = simplex[0].a, nearest.vertex_b = simplex[0].b;
  for (int i = 0; i < simplex.count(); ++i) {
    nearest.on_a += simplex.weight(i) * a.vertex(simplex[i].a);
    nearest.on_b += simplex.weight(i) * b.vertex(simplex[i].b);
    nearest.vertex_a = std::min(nearest.vertex_a, simplex[i].a);
    nearest.vertex_b = std::min(nearest.vertex_b, simplex[i].b);
  }
  nearest.distance = v.norm();
  return nearest;
}

// ---- axes

/// Search for the axis of least depth.
class AxisSearch {
 public:
  AxisSearch(const Polytope& a, const Polytope& b)
      : a_(a), b_(b), size_(a.radius + b.radius + (a.centre - b.centre).norm()) {
    least_.depth = kInfinity;
  }

  PolytopeAxis find() {
    for (int i = 0; i < a_.faces(); ++i) {
      const Vector3d n = -a_.normal(i);
      take(n, a_.extent_of_face(i) + b_.support_extent(n), -1, -1);
    }
    for (int i = 0; i < b_.faces(); ++i) {
      const Vector3d n = b_.normal(i);
      take(n, b_.extent_of_face(i) + a_.support_extent(-n), -1, -1);
    }
    const std::vector<Arc> of_b = arcs(b_, a_, -1.0);
    for (const Arc& arc : arcs(a_, b_, 1.0))
      for (const Arc& other : of_b) try_edges(arc, other);
    return least_;
  }

 private:
  /// Arc of an edge on the Gauss map, between the outward normals of A on both sides of the edge.
  struct Arc {
    int edge;
    Vector3d from, to;
    Vector3d direction;  ///< direction of the edge, unit
  };

  // Returns the arcs on which the depth may be less than the depth of faces. Along an arc the depth
  // differs from its value in the middle by at most the size times the distance of directions.
  std::vector<Arc> arcs(const Polytope& of, const Polytope& other, double sign) const {
    std::vector<Arc> found;
    found.reserve(static_cast<std::size_t>(of.edges()));
    for (int i = 0; i < of.edges(); ++i) {
      const ConvexHull::Edge& edge = of.edge(i);
      const Vector3d from = of.normal(edge.left), to = of.normal(edge.right);
      const Vector3d middle = (from + to).normalized();
      const double depth = middle.dot(of.vertex(edge.from)) + other.support_extent(-middle);
      if (depth - size_ * (from - middle).norm() > least_.depth) continue;
      found.push_back({i, sign * from, sign * to, of.direction(i).normalized()});
    }
    return found;
  }

  void take(const Vector3d& n, double depth, int edge_a, int edge_b) {
    if (!(depth < least_.depth - kTieShare * size_)) return;
    least_ = {n, depth, edge_a, edge_b};
  }

  void try_edges(const Arc& a, const Arc& b) {
    const Vector3d across_a = a.from.cross(a.to), across_b = b.from.cross(b.to);
    const double from_b = across_a.dot(b.from), to_b = across_a.dot(b.to);
    const double from_a = across_b.dot(a.from), to_a = across_b.dot(a.to);
    if (from_b * to_b > 0.0 || from_a * to_a > 0.0 || from_a * to_b < 0.0) return;
    const Vector3d cross = a.direction.cross(b.direction);
    const double sine = cross.norm();
    if (!(sine > kParallelSine)) return;
    const Vector3d outward = a.from + a.to;
    const Vector3d n = cross / (cross.dot(outward) > 0.0 ? -sine : sine);
    const double between = n.dot(b_.vertex(b_.edge(b.edge).from) - a_.vertex(a_.edge(a.edge).from));
    if (!(between < least_.depth)) return;
    take(n, a_.support_extent(-n) + b_.support_extent(n), a.edge, b.edge);
  }

  const Polytope& a_;
  const Polytope& b_;
  double size_;
  PolytopeAxis least_;
};

}  // namespace

Polytope::Polytope(const Vector3d& size_of_box, const BodyState& state, const Vector3d& origin)
    : surface(unit_cube()),
      centre(state.position - origin),
      axes(state.orientation.toRotationMatrix()),
      scale(size_of_box),
      radius(0.5 * size_of_box.norm()) {}

int Polytope::nearest_face(const Vector3d& direction) const {
  const Vector3d local = axes.transpose() * direction;
  int best = 0;
  double most = -kInfinity;
  for (int i = 0; i < faces(); ++i) {
    const double cosine = face(i).normal.dot(local);
    if (cosine > most) most = cosine, best = i;
  }
  return best;
}

NearestPoints nearest_points(const Polytope& a, const Polytope& b, double margin) {
  return nearest_of(a, b, a.radius + b.radius, margin);
}

NearestPoints nearest_points(const Segment& a, const Polytope& b, double margin) {
  return nearest_of(a, b, a.half + b.radius, margin);
}

PolytopeAxis least_axis(const Polytope& a, const Polytope& b) { return AxisSearch(a, b).find(); }

}  // namespace constraint_sim::engine
