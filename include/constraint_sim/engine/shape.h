#pragma once

#include <Eigen/Core>
#include <variant>

namespace constraint_sim::engine {

/// Collides with nothing and does not rotate unless it is given an inertia.
struct Point {};

/// Centred on the body's origin.
struct Sphere {
  double radius = 0.0;  ///< [m] > 0
};

/// Centred on the body's origin, edges along the body's axes.
struct Box {
  Eigen::Vector3d size = Eigen::Vector3d::Zero();  ///< whole edge lengths [m], each > 0
};

/// The half-space below the body's x-y plane is solid; the outward normal is the body's z axis.
/// Static or kinematic bodies only.
struct Plane {};

/// Centred on the body's origin, along the body's z axis, with flat ends.
struct Cylinder {
  double radius = 0.0;  ///< [m] > 0
  double length = 0.0;  ///< from end to end [m] > 0
};

using Shape = std::variant<Point, Sphere, Box, Plane, Cylinder>;

/// Principal moments of inertia of a homogeneous solid of unit mass [m²]; zero for Point and Plane.
Eigen::Vector3d unit_inertia(const Shape& shape);

/// Throws std::invalid_argument naming the dimension that is not a finite number > 0.
void validate(const Shape& shape);

}  // namespace constraint_sim::engine
