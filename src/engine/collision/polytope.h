#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <algorithm>
#include <cstdint>

#include "constraint_sim/engine/body.h"
#include "constraint_sim/engine/convex_hull.h"

namespace constraint_sim::engine {

/// A convex hull, or a box as the scaled hull of a cube, with a pose relative to the origin of a
/// pair [m]. Vertices, faces and edges have the numbers of the hull.
class Polytope {
 public:
  Polytope(const Hull& hull, const BodyState& state, const Eigen::Vector3d& origin)
      : surface(*hull.surface),
        centre(state.position - origin),
        axes(state.orientation.toRotationMatrix()),
        radius(surface.radius()) {}
  Polytope(const Eigen::Vector3d& size_of_box, const BodyState& state,
           const Eigen::Vector3d& origin);

  int faces() const { return static_cast<int>(surface.faces().size()); }
  int edges() const { return static_cast<int>(surface.edges().size()); }
  int vertices() const { return static_cast<int>(surface.vertices().size()); }

  const ConvexHull::Face& face(int i) const { return surface.faces()[static_cast<std::size_t>(i)]; }
  const ConvexHull::Edge& edge(int i) const { return surface.edges()[static_cast<std::size_t>(i)]; }
  const ConvexHull::Corner& corner(const ConvexHull::Face& of, int k) const {
    return surface.corners()[static_cast<std::size_t>(of.first + k)];
  }

  Eigen::Vector3d local_vertex(int i) const {
    return surface.vertices()[static_cast<std::size_t>(i)].cwiseProduct(scale);
  }
  Eigen::Vector3d vertex(int i) const { return centre + axes * local_vertex(i); }
  Eigen::Vector3d normal(int i) const { return axes * face(i).normal; }
  Eigen::Vector3d direction(int i) const { return axes * edge(i).direction.cwiseProduct(scale); }

  /// Returns the vertex farthest along a direction, the first on ties.
  int farthest(const Eigen::Vector3d& direction) const {
    return surface.farthest((axes.transpose() * direction).cwiseProduct(scale));
  }
  /// Returns the greatest coordinate along a direction [m].
  double support_extent(const Eigen::Vector3d& direction) const {
    return direction.dot(vertex(farthest(direction)));
  }
  /// Returns the greatest coordinate along the normal of a face [m].
  double extent_of_face(int i) const {
    const Eigen::Vector3d& n = face(i).normal;
    return n.cwiseAbs2().dot(scale) * face(i).offset + normal(i).dot(centre);
  }
  /// Returns the face whose normal is nearest to a direction, the first on ties.
  int nearest_face(const Eigen::Vector3d& direction) const;

  const ConvexHull& surface;
  Eigen::Vector3d centre;                           ///< origin of the hull [m]
  Eigen::Matrix3d axes;                             ///< axes in columns
  Eigen::Vector3d scale = Eigen::Vector3d::Ones();  ///< size along the axes, 1 for a hull
  double radius;                                    ///< greatest distance from `centre` [m]
};

/// A line between two vertices, 0 and 1, relative to the origin of a pair [m].
struct Segment {
  Eigen::Vector3d at(double place) const { return centre + place * axis; }
  Eigen::Vector3d vertex(int i) const { return at(i == 0 ? -half : half); }
  /// Returns the vertex farthest along a direction, the second on ties.
  int farthest(const Eigen::Vector3d& direction) const { return axis.dot(direction) < 0.0 ? 0 : 1; }
  /// Returns the greatest coordinate along a direction [m].
  double support_extent(const Eigen::Vector3d& direction) const {
    return direction.dot(vertex(farthest(direction)));
  }
  /// Returns the place that is nearest to a point [m].
  double nearest(const Eigen::Vector3d& point) const {
    return std::clamp(axis.dot(point - centre), -half, half);
  }

  Eigen::Vector3d centre, axis;  ///< middle, and unit direction
  double half;                   ///< half length [m]
};

/// Nearest points of two polytopes.
struct NearestPoints {
  Eigen::Vector3d on_a, on_b;      ///< relative to the origin of the pair [m]
  double distance = 0.0;           ///< [m]; 0 for polytopes that touch or overlap to rounding
  bool is_beyond = false;          ///< farther apart than the margin, with no points
  int vertex_a = 0, vertex_b = 0;  ///< a vertex of each feature, the lowest
};

/// Return the nearest points (Gilbert, Johnson & Keerthi 1988); end where the distance is known
/// to be at least the margin [m].
NearestPoints nearest_points(const Polytope& a, const Polytope& b, double margin);
NearestPoints nearest_points(const Segment& a, const Polytope& b, double margin);

/// Axis of least depth of two polytopes.
struct PolytopeAxis {
  Eigen::Vector3d normal = Eigen::Vector3d::UnitZ();  ///< unit, from B to A
  double depth = 0.0;                                 ///< [m]; negative for a gap
  int edge_a = -1, edge_b = -1;                       ///< edges across the axis, if any
};

/// Returns the axis of least depth among normals of faces and of pairs of edges whose arcs cross on
/// the Gauss map (Gregorius 2013); the first on ties.
PolytopeAxis least_axis(const Polytope& a, const Polytope& b);

}  // namespace constraint_sim::engine
