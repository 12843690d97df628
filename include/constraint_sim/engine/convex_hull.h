#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <vector>

namespace constraint_sim::engine {

/// Greatest number of points that a hull is made of, and greatest number of vertices that it may
/// have.
inline constexpr std::size_t kMostHullPoints = 100000, kMostHullVertices = 512;

/// Surface of a convex hull: vertices, flat faces with their corners, and edges. Immutable; shapes
/// share it.
class ConvexHull {
 public:
  /// A flat face, outside of which there is no vertex: normal·x ≤ offset.
  struct Face {
    Eigen::Vector3d normal;  ///< unit, outward
    double offset;           ///< distance from the origin along the normal [m]
    int first, count;        ///< corners, counter-clockwise as seen from outside
  };
  /// A corner of a face.
  struct Corner {
    int vertex;
    int edge;  ///< edge from this corner to the next corner
  };
  /// An edge between two faces, with the vertices in the order of the first face.
  struct Edge {
    int from, to;               ///< vertices
    int left, right;            ///< faces; `left` has the edge from `from` to `to`
    Eigen::Vector3d direction;  ///< from the first vertex to the second [m]
  };

  /// Computes the hull of points [m] with Qhull (Barber, Dobkin & Huhdanpaa 1996). Triangles that
  /// lie in a plane to 1e-6 of the size become one face. Throws std::invalid_argument for fewer
  /// than 4 or more than kMostHullPoints points, numbers that are not finite, points in a plane to
  /// 1e-6 of their size, and more than kMostHullVertices vertices.
  explicit ConvexHull(const std::vector<Eigen::Vector3d>& points);

  /// Points that are vertices, in their given order. Their hull has the same vertices.
  const std::vector<Eigen::Vector3d>& vertices() const { return vertices_; }
  const std::vector<Face>& faces() const { return faces_; }
  const std::vector<Corner>& corners() const { return corners_; }
  const std::vector<Edge>& edges() const { return edges_; }

  double radius() const { return radius_; }        ///< greatest distance of a vertex from 0 [m]
  double thickness() const { return thickness_; }  ///< least width across a face [m]
  double volume() const { return volume_; }        ///< [m³]
  const Eigen::Vector3d& centre() const { return centre_; }  ///< centre of the volume [m]
  /// Principal axes of inertia of the homogeneous solid about its centre, in columns, nearest to
  /// the axes of the vertices.
  const Eigen::Matrix3d& axes() const { return axes_; }
  /// Principal moments of inertia of the homogeneous solid of mass 1, in the order of axes() [m²].
  const Eigen::Vector3d& unit_inertia() const { return unit_inertia_; }

  /// Whether centre() is 0 and axes() are those of the vertices, to 1e-12 of the size.
  bool is_centred() const { return is_centred_; }

  /// Returns the vertex farthest along a direction, the first on ties.
  int farthest(const Eigen::Vector3d& direction) const {
    int best = 0;
    double most = vertices_[0].dot(direction);
    for (std::size_t i = 1; i < vertices_.size(); ++i) {
      const double along = vertices_[i].dot(direction);
      if (along > most) most = along, best = static_cast<int>(i);
    }
    return best;
  }

 private:
  void build_faces(std::vector<std::vector<int>> polygons);
  void integrate();

  std::vector<Eigen::Vector3d> vertices_;
  std::vector<Face> faces_;
  std::vector<Corner> corners_;
  std::vector<Edge> edges_;
  double radius_ = 0.0, thickness_ = 0.0, volume_ = 0.0;
  Eigen::Vector3d centre_ = Eigen::Vector3d::Zero();
  Eigen::Matrix3d axes_ = Eigen::Matrix3d::Identity();
  Eigen::Vector3d unit_inertia_ = Eigen::Vector3d::Zero();
  bool is_centred_ = false;
};

}  // namespace constraint_sim::engine
