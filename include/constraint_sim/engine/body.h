#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <array>
#include <cstdint>
#include <optional>
#include <string>

#include "constraint_sim/engine/shape.h"

namespace constraint_sim::engine {

enum class BodyType {
  kDynamic,    ///< moved by forces and constraints
  kStatic,     ///< never moves
  kKinematic,  ///< moves at its set twist, whatever forces act
};

/// Pose and twist of a body. The body frame sits in the centre of mass, along the principal axes of
/// inertia.
struct BodyState {
  Eigen::Vector3d position = Eigen::Vector3d::Zero();               ///< centre of mass, world [m]
  Eigen::Quaterniond orientation = Eigen::Quaterniond::Identity();  ///< body to world, unit
  /// Velocity of the centre of mass, world [m/s].
  Eigen::Vector3d linear_velocity = Eigen::Vector3d::Zero();
  /// Angular velocity, world axes [rad/s].
  Eigen::Vector3d angular_velocity = Eigen::Vector3d::Zero();
};

/// Mask of a body that collides with bodies of all groups.
inline constexpr std::uint32_t kAllGroups = 0xffffffff;

/// A rigid body as it is added to a World. `state` is the initial state, to which reset() returns.
struct Body {
  std::string name;  ///< `[A-Za-z0-9_][A-Za-z0-9_./-]*`, unique, not `world`
  BodyType type = BodyType::kDynamic;
  Shape shape = Point{};
  /// Pose of a sphere, box, cylinder, capsule or hull; left out: shape centred in the centre of
  /// mass, along the principal axes. A dynamic body with a `shape_pose` needs an `inertia`. The
  /// parts of a compound have their own poses.
  std::optional<ShapePose> shape_pose;
  double mass = 0.0;  ///< [kg] > 0 for dynamic bodies; otherwise not used
  /// Principal moments [kg m²]; zero: from the shape.
  Eigen::Vector3d inertia = Eigen::Vector3d::Zero();
  BodyState state;
  double friction = 0.0;     ///< Coulomb's coefficient ≥ 0; a pair has the geometric mean
  double restitution = 0.0;  ///< Newton's coefficient in [0, 1]; a pair has the larger
  bool no_collision = false;
  /// Two bodies collide where the groups of each have a bit of the mask of the other. A bit for
  /// each group of the body, and for each group with which it collides; not 0.
  std::uint32_t collision_groups = 1, collision_mask = kAllGroups;
  /// Share of the weight, in [0, 1], that is carried without a joint or contact: the body falls
  /// with (1 − share) g, and its potential energy has that factor.
  double gravity_compensation = 0.0;
  /// Red, green, blue and opacity for viewers, each in [0, 1]; left out: by the type. Colour
  /// affects neither motion nor hashes.
  std::optional<std::array<double, 4>> color;
};

/// Throws std::invalid_argument naming the invalid field and its value. Does not check that the
/// name is unique.
void validate(const Body& body);

/// Throws std::invalid_argument unless all numbers are finite and the quaternion has unit norm to 1
/// %.
void validate(const BodyState& state);

/// Throws std::invalid_argument unless the pose is finite and its quaternion has unit norm to 1 %.
void validate(const ShapePose& pose);

}  // namespace constraint_sim::engine
