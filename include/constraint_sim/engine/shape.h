#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <cstddef>
#include <memory>
#include <optional>
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

/// Greatest number of parts of a compound.
inline constexpr std::size_t kMostParts = 4096;

struct ShapePart;

/// Several convex shapes fixed to one body, each with its pose in the body. Parts may overlap and
/// do not collide with each other. Copies share the parts.
struct Compound {
  using Parts = std::vector<ShapePart>;

  Compound() = default;
  /// Throws std::invalid_argument for no parts, for more than kMostParts, and for a part that is a
  /// point, a plane or a compound, or that has an invalid dimension or pose.
  explicit Compound(Parts parts);

  std::shared_ptr<const Parts> parts;  ///< none in a compound without parts, which is invalid
};

using Shape = std::variant<Point, Sphere, Box, Plane, Cylinder, Hull, Capsule, Compound>;

/// Pose of a shape in the frame of its body.
struct ShapePose {
  Eigen::Vector3d position = Eigen::Vector3d::Zero();               ///< centre of the shape [m]
  Eigen::Quaterniond orientation = Eigen::Quaterniond::Identity();  ///< shape to body, unit
};

/// A part of a compound.
struct ShapePart {
  Shape shape;
  ShapePose pose;
  /// Coulomb's coefficient ≥ 0; none: that of the body.
  std::optional<double> friction = std::nullopt;
  /// Newton's coefficient, 0 to 1; none: that of the body.
  std::optional<double> restitution = std::nullopt;
};

/// Number of convex shapes of a shape: parts of a compound, else 1.
inline std::size_t part_count(const Shape& shape) {
  const auto* compound = std::get_if<Compound>(&shape);
  return compound == nullptr ? 1 : compound->parts->size();
}
/// Returns a part of a shape by its number; null for a shape that is no compound.
inline const ShapePart* find_part(const Shape& shape, int part) {
  const auto* compound = std::get_if<Compound>(&shape);
  return compound == nullptr ? nullptr : &(*compound->parts)[static_cast<std::size_t>(part)];
}

/// Returns a convex shape of a shape, by the number of the part: a part of a compound, or the shape
/// itself.
inline const Shape& part_of(const Shape& shape, int part) {
  const ShapePart* found = find_part(shape, part);
  return found == nullptr ? shape : found->shape;
}

/// Volume of a shape [m³], of a compound the sum over its parts; zero for Point and Plane.
double volume(const Shape& shape);

/// Centre of mass of a homogeneous compound, its density equal in all parts, and its moments of
/// inertia about this centre for unit mass [m²], along the axes of the body. Where parts overlap,
/// their masses add up.
struct CompoundMass {
  Eigen::Vector3d centre;
  Eigen::Matrix3d unit_inertia;
};
CompoundMass mass_of(const Compound& compound);

/// Principal moments of inertia of a homogeneous solid of unit mass [m²]; zero for Point and Plane.
/// A compound has them along the axes of its body, about its centre of mass.
Eigen::Vector3d unit_inertia(const Shape& shape);

/// Throws std::invalid_argument naming the dimension that is not a finite number > 0.
void validate(const Shape& shape);

}  // namespace constraint_sim::engine
