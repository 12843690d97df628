#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <array>
#include <optional>
#include <string>

#include "constraint_sim/engine/shape.h"

namespace constraint_sim::engine {

enum class BodyType {
  kDynamic,    ///< moved by forces and constraints
  kStatic,     ///< never moves
  kKinematic,  ///< moves at its set twist, whatever pulls at it
};

/// Where a body is and how it moves. The body frame sits in the centre of mass, along the
/// principal axes of inertia.
struct BodyState {
  Eigen::Vector3d position = Eigen::Vector3d::Zero();               ///< centre of mass, world [m]
  Eigen::Quaterniond orientation = Eigen::Quaterniond::Identity();  ///< body to world, unit
  Eigen::Vector3d linear_velocity =
      Eigen::Vector3d::Zero();  ///< of the centre of mass, world [m/s]
  Eigen::Vector3d angular_velocity = Eigen::Vector3d::Zero();  ///< world axes [rad/s]
};

/// Where a shape lies in the frame of its body.
struct ShapePose {
  Eigen::Vector3d position = Eigen::Vector3d::Zero();               ///< of its centre [m]
  Eigen::Quaterniond orientation = Eigen::Quaterniond::Identity();  ///< shape to body, unit
};

/// A rigid body as it is added to a World. `state` is the state it starts with and returns to.
struct Body {
  std::string name;  ///< `[A-Za-z0-9_][A-Za-z0-9_./-]*`, unique, not `world`
  BodyType type = BodyType::kDynamic;
  Shape shape = Point{};
  /// Of a sphere or a box; left out: in the centre of mass, along the principal axes. With one, a
  /// dynamic body needs an `inertia`.
  std::optional<ShapePose> shape_pose;
  double mass = 0.0;  ///< [kg] > 0 for dynamic bodies; otherwise not used
  Eigen::Vector3d inertia = Eigen::Vector3d::Zero();  ///< principal [kg m²]; zero: from the shape
  BodyState state;
  double friction = 0.0;     ///< Coulomb's coefficient ≥ 0; a pair has the geometric mean
  double restitution = 0.0;  ///< Newton's coefficient in [0, 1]; a pair has the larger
  bool no_collision = false;
  /// Red, green, blue and opacity for viewers, each in [0, 1]; left out: by the type. Motion and
  /// hashes do not depend on it.
  std::optional<std::array<double, 4>> color;
};

/// Throws std::invalid_argument naming the field and value that cannot be. Names are not looked up.
void validate(const Body& body);

/// Throws std::invalid_argument unless all numbers are finite and the quaternion is a unit one
/// to 1 %.
void validate(const BodyState& state);

/// The same of a shape in its body's frame.
void validate(const ShapePose& pose);

}  // namespace constraint_sim::engine
