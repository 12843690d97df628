// Contacts of a box with planes and spheres.

#include <cmath>

#include "engine/collision/manifold_points.h"
#include "engine/collision/narrowphase.h"

namespace constraint_sim::engine {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;

/// A box in world coordinates.
struct OrientedBox {
  OrientedBox(const Vector3d& size, const BodyState& state)
      : centre(state.position), axes(state.orientation.toRotationMatrix()), half(0.5 * size) {}

  /// Returns the arm from the centre to a side [m].
  Vector3d arm(int axis, bool upper) const {
    return axes.col(axis) * (upper ? half[axis] : -half[axis]);
  }

  Vector3d centre;
  Matrix3d axes;  ///< axes in columns
  Vector3d half;  ///< half edge lengths [m]
};

}  // namespace

Manifold Collide::operator()(const Box& box_a, const Plane&) const {
  const Vector3d N = normal_of_plane(b);
  const double d = N.dot(b.position);
  const OrientedBox box(box_a.size, a);
  Manifold manifold;
  manifold.normal = N;
  for (std::uint32_t vertex = 0; vertex < 8; ++vertex) {
    const Vector3d position = box.centre + box.arm(0, (vertex & 1u) != 0) +
                              box.arm(1, (vertex & 2u) != 0) + box.arm(2, (vertex & 4u) != 0);
    const double depth = d - N.dot(position);
    add_point(manifold, position + depth * N, depth, vertex, margin);
  }
  return manifold;
}

Manifold Collide::operator()(const Box& box_a, const Sphere& sphere_b) const {
  const OrientedBox box(box_a.size, a);
  const Vector3d centre = box.axes.transpose() * (b.position - box.centre);
  const Vector3d nearest = centre.cwiseMax(-box.half).cwiseMin(box.half);
  const double distance_squared = (nearest - centre).squaredNorm();
  if (distance_squared >= (sphere_b.radius + margin) * (sphere_b.radius + margin)) return {};

  Manifold manifold;
  double depth = 0.0;
  if (distance_squared >= kSmallestSquare) {
    const double distance = std::sqrt(distance_squared);
    manifold.normal = box.axes * (nearest - centre) / distance;
    depth = sphere_b.radius - distance;
  } else {
    // A centre inside the box leaves through the nearest face, the first on ties.
    int k = 0;
    const double below_face = (box.half - centre.cwiseAbs()).minCoeff(&k);
    manifold.normal = box.axes.col(k) * (centre[k] < 0.0 ? 1.0 : -1.0);
    depth = sphere_b.radius + below_face;
  }
  add_point(manifold, b.position + sphere_b.radius * manifold.normal, depth, 0, margin);
  return manifold;
}

}  // namespace constraint_sim::engine
