#include "constraint_sim/engine/convex_hull.h"

#include <Eigen/Dense>
#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <numeric>
#include <string>
#include <utility>

#include "engine/math/numbers.h"
#include "engine/model/hull_triangles.h"
#include "engine/model/principal_axes.h"
#include "engine/model/validate.h"

namespace constraint_sim::engine {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;
using VertexTriple = std::array<int, 3>;
using VertexLoop = std::vector<int>;

// Share of the size within which points lie in one plane, and below which a hull is flat. Files of
// meshes have single precision.
constexpr double kFlat = 1e-6;
// Number of vertices at which Qhull gives up. Hulls of some of the points may have vertices that
// are inside at the end.
constexpr std::size_t kMostGrowing = 2048;

const Vector3d& at(const std::vector<Vector3d>& list, int i) {
  return list[static_cast<std::size_t>(i)];
}

double greatest_distance(const std::vector<Vector3d>& points, const Vector3d& from) {
  double most = 0.0;
  for (const Vector3d& p : points) most = std::max(most, (p - from).norm());
  return most;
}

/// Returns the points that are vertices of the triangles, in their order.
std::vector<Vector3d> used_points(const std::vector<Vector3d>& points,
                                  const std::vector<VertexTriple>& triangles) {
  std::vector<bool> is_used(points.size(), false);
  for (const VertexTriple& triangle : triangles)
    for (const int i : triangle) is_used[static_cast<std::size_t>(i)] = true;
  std::vector<Vector3d> used;
  for (std::size_t i = 0; i < points.size(); ++i)
    if (is_used[i]) used.push_back(points[i]);
  return used;
}

/// Triangles of a hull, with the triangle beyond each of their edges.
class Triangulation {
 public:
  Triangulation(const std::vector<Vector3d>& points, std::vector<VertexTriple> triangles)
      : points_(points), triangles_(std::move(triangles)) {
    std::map<std::pair<int, int>, int> owners;
    for (int t = 0; t < size(); ++t)
      for (int k = 0; k < 3; ++k) owners[{corner(t, k), corner(t, k + 1)}] = t;
    is_closed_ = owners.size() == 3 * triangles_.size();
    for (int t = 0; t < size(); ++t)
      for (int k = 0; k < 3; ++k) {
        const auto found = owners.find({corner(t, k + 1), corner(t, k)});
        is_closed_ = is_closed_ && found != owners.end();
        beyond_.push_back(found == owners.end() ? -1 : found->second);
      }
  }

  /// Whether each edge has a triangle on both sides, in opposite directions.
  bool is_closed() const { return is_closed_; }

  /// Returns polygons of triangles in one plane to `width`; all triangles if a polygon were not
  /// simple.
  std::vector<VertexLoop> polygons(double width) const {
    std::vector<int> order(triangles_.size());
    std::iota(order.begin(), order.end(), 0);
    std::vector<double> areas;
    for (int t = 0; t < size(); ++t) areas.push_back(normal(t).norm());
    std::stable_sort(order.begin(), order.end(), [&](int l, int r) {
      return areas[static_cast<std::size_t>(l)] > areas[static_cast<std::size_t>(r)];
    });
    std::vector<int> region(triangles_.size(), -1);
    std::vector<VertexLoop> found;
    for (const int seed : order) {
      if (region[static_cast<std::size_t>(seed)] >= 0) continue;
      grow(seed, width, &region);
      VertexLoop border = border_of(seed, region);
      if (border.empty()) return all();
      found.push_back(std::move(border));
    }
    return found;
  }

 private:
  int size() const { return static_cast<int>(triangles_.size()); }
  int corner(int triangle, int k) const {
    return triangles_[static_cast<std::size_t>(triangle)][static_cast<std::size_t>(k % 3)];
  }
  int beyond(int triangle, int k) const {
    return beyond_[static_cast<std::size_t>(3 * triangle + k)];
  }
  const Vector3d& p(int triangle, int k) const { return at(points_, corner(triangle, k)); }
  Vector3d normal(int t) const { return (p(t, 1) - p(t, 0)).cross(p(t, 2) - p(t, 0)); }

  std::vector<VertexLoop> all() const {
    std::vector<VertexLoop> found;
    for (const VertexTriple& triangle : triangles_)
      found.emplace_back(triangle.begin(), triangle.end());
    return found;
  }

  // Gives the number of the seed to it and to all connected triangles in its plane.
  void grow(int seed, double width, std::vector<int>* region) const {
    const Vector3d n = normal(seed).normalized();
    std::vector<int> open{seed};
    (*region)[static_cast<std::size_t>(seed)] = seed;
    while (!open.empty()) {
      const int t = open.back();
      open.pop_back();
      for (int k = 0; k < 3; ++k) {
        const int next = beyond(t, k);
        if ((*region)[static_cast<std::size_t>(next)] >= 0) continue;
        bool is_level = true;
        for (int i = 0; i < 3; ++i)
          is_level = is_level && std::abs(n.dot(p(next, i) - p(seed, 0))) <= width;
        if (!is_level) continue;
        (*region)[static_cast<std::size_t>(next)] = seed;
        open.push_back(next);
      }
    }
  }

  // Returns the border of a region from its lowest vertex on; empty unless it is one loop.
  VertexLoop border_of(int seed, const std::vector<int>& region) const {
    std::map<int, int> next;
    for (int t = 0; t < size(); ++t)
      if (region[static_cast<std::size_t>(t)] == seed)
        for (int k = 0; k < 3; ++k)
          if (region[static_cast<std::size_t>(beyond(t, k))] != seed &&
              !next.emplace(corner(t, k), corner(t, k + 1)).second)
            return {};
    VertexLoop border;
    if (next.empty()) return border;
    const int first = next.begin()->first;
    for (int vertex = first; border.size() < next.size();) {
      border.push_back(vertex);
      const auto found = next.find(vertex);
      if (found == next.end()) return {};
      vertex = found->second;
      if (vertex == first) break;
    }
    if (border.size() != next.size() || border.size() < 3) return {};
    return border;
  }

  const std::vector<Vector3d>& points_;
  std::vector<VertexTriple> triangles_;
  std::vector<int> beyond_;
  bool is_closed_ = true;
};

void check_points(const std::vector<Vector3d>& points) {
  if (points.size() < 4)
    refuse("vertices", "must be at least 4, got " + std::to_string(points.size()));
  if (points.size() > kMostHullPoints)
    refuse("vertices", "must be at most " + std::to_string(kMostHullPoints) + ", got " +
                           std::to_string(points.size()));
  for (const Vector3d& p : points) check_finite("vertices", p);
}

}  // namespace

ConvexHull::ConvexHull(const std::vector<Vector3d>& points) {
  check_points(points);
  vertices_ = points.size() > kMostGrowing ? hull_vertices(points, kMostGrowing) : points;
  std::vector<VertexTriple> triangles;
  // A hull of the vertices alone may drop a vertex that lies in a face to rounding.
  for (std::size_t before = 0; before != vertices_.size();) {
    before = vertices_.size();
    triangles = hull_triangles(vertices_);
    vertices_ = used_points(vertices_, triangles);
  }
  if (vertices_.size() > kMostHullVertices)
    refuse("vertices", "the hull may have at most " + std::to_string(kMostHullVertices) +
                           " vertices, got " + std::to_string(vertices_.size()));
  radius_ = greatest_distance(vertices_, Vector3d::Zero());
  const double size = greatest_distance(vertices_, vertices_[0]);
  const Triangulation triangulation(vertices_, triangles);
  if (!triangulation.is_closed()) refuse("vertices", "the points lie too close to a plane");
  build_faces(triangulation.polygons(kFlat * size));
  thickness_ = kInfinity;
  for (const Face& face : faces_)
    thickness_ =
        std::min(thickness_, face.offset - at(vertices_, farthest(-face.normal)).dot(face.normal));
  if (!(thickness_ > kFlat * size))
    refuse("vertices", "the points lie in a plane: the hull is " + shortest(thickness_) +
                           " m thick and " + shortest(size) + " m wide");
  check_positive("vertices: thickness of the hull", thickness_);  // volume and moments are above 0
  integrate();
  // Faces that are flat to a share of a needle's length may enclose no solid.
  if (!(volume_ > 0.0 && unit_inertia_.minCoeff() > 0.0))
    refuse("vertices", "the points lie too close to a plane or line");
}

void ConvexHull::build_faces(std::vector<VertexLoop> polygons) {
  std::sort(polygons.begin(), polygons.end());
  std::map<std::pair<int, int>, int> edges;
  for (const VertexLoop& polygon : polygons) {
    Face face{Vector3d::Zero(), -kInfinity, static_cast<int>(corners_.size()),
              static_cast<int>(polygon.size())};
    const Vector3d& origin = at(vertices_, polygon[0]);
    for (std::size_t k = 1; k + 1 < polygon.size(); ++k)
      face.normal +=
          (at(vertices_, polygon[k]) - origin).cross(at(vertices_, polygon[k + 1]) - origin);
    face.normal.normalize();
    const int number = static_cast<int>(faces_.size());
    for (std::size_t k = 0; k < polygon.size(); ++k) {
      const int from = polygon[k], to = polygon[(k + 1) % polygon.size()];
      const auto reverse = edges.find({to, from});
      if (reverse == edges.end()) {
        edges[{from, to}] = static_cast<int>(edges_.size());
        corners_.push_back({from, static_cast<int>(edges_.size())});
        edges_.push_back({from, to, number, -1, at(vertices_, to) - at(vertices_, from)});
      } else {
        edges_[static_cast<std::size_t>(reverse->second)].right = number;
        corners_.push_back({from, reverse->second});
      }
    }
    face.offset = face.normal.dot(at(vertices_, farthest(face.normal)));
    faces_.push_back(face);
  }
}

// Sums tetrahedra of a triangle of a face and the first vertex (Tonon 2004).
void ConvexHull::integrate() {
  const Vector3d origin = vertices_[0];
  Vector3d first = Vector3d::Zero();
  Matrix3d second = Matrix3d::Zero();
  for (const Face& face : faces_) {
    const auto arm = [&](int k) -> Vector3d {
      return at(vertices_, corners_[static_cast<std::size_t>(face.first + k)].vertex) - origin;
    };
    for (int k = 1; k + 1 < face.count; ++k) {
      const Vector3d a = arm(0), b = arm(k), c = arm(k + 1), sum = a + b + c;
      const double volume = a.dot(b.cross(c)) / 6.0;
      volume_ += volume;
      first += volume / 4.0 * sum;
      second += volume / 20.0 *
                (a * a.transpose() + b * b.transpose() + c * c.transpose() + sum * sum.transpose());
    }
  }
  const Vector3d arm = first / volume_;
  centre_ = origin + arm;
  const Matrix3d moments = second / volume_ - arm * arm.transpose();  // about the centre
  const Matrix3d tensor = moments.trace() * Matrix3d::Identity() - moments;
  const double size = greatest_distance(vertices_, centre_);
  const PrincipalAxes principal = principal_axes(tensor, kCentred * size * size);
  axes_ = principal.axes;
  unit_inertia_ = principal.moments;
  is_centred_ = principal.is_along && centre_.norm() <= kCentred * size;
}

}  // namespace constraint_sim::engine
