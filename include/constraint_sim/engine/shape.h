#pragma once

#include <Eigen/Core>
#include <memory>
#include <variant>
#include <vector>

#include "constraint_sim/engine/convex_hull.h"

namespace constraint_sim::engine {

/// A point: collides with nothing, and rotates only where the body has an inertia.
struct Point {};

/// A sphere, centred on the body's origin.
struct Sphere {
  double radius = 0.0;  ///< [m] > 0
};

/// A box, centred on the body's origin, edges along the body's axes.
struct Box {
  Eigen::Vector3d size = Eigen::Vector3d::Zero();  ///< edge lengths [m], each > 0
};

/// A solid half-space below the body's x-y plane; the outward normal is the body's z axis. For
/// static or kinematic bodies only.
struct Plane {};

/// A cylinder with flat ends, centred on the body's origin, along the body's z axis.
struct Cylinder {
  double radius = 0.0;  ///< [m] > 0
  double length = 0.0;  ///< from end to end [m] > 0
};

/// A capsule: a cylinder with half spheres as ends, centred on the body's origin, along the body's
/// z axis.
struct Capsule {
  double radius = 0.0;  ///< [m] > 0
  double length = 0.0;  ///< between the centres of the half spheres [m] > 0
};

/// A convex hull of points. A body has the hull with its centre in 0 and its principal axes along
/// the axes; World::add_body() moves other hulls there, and sets the shape_pose that keeps their
/// place in the body. Copies share the surface.
struct Hull {
  Hull() = default;
  /// Throws std::invalid_argument as ConvexHull() does.
  explicit Hull(const std::vector<Eigen::Vector3d>& vertices)
      : surface(std::make_shared<const ConvexHull>(vertices)) {}

  std::shared_ptr<const ConvexHull> surface;  ///< none in a hull without vertices, which is invalid
};

using Shape = std::variant<Point, Sphere, Box, Plane, Cylinder, Hull, Capsule>;

/// Principal moments of inertia of a homogeneous solid of unit mass [m²]; zero for Point and Plane.
Eigen::Vector3d unit_inertia(const Shape& shape);

/// Throws std::invalid_argument naming the dimension that is not a finite number > 0.
void validate(const Shape& shape);

}  // namespace constraint_sim::engine
