#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "constraint_sim/engine/id.h"

namespace constraint_sim::engine {

class World;

/// Coordinate of a robot, at the present state.
///
/// A joint's coordinate is a motion of B relative to A. A free base has six coordinates: the
/// velocity of its centre of mass in world axes [m/s], then its angular velocity in axes of the
/// body [rad/s]. Joints that turn by three angles have the angular velocity of the body farther
/// from the base relative to the nearer one, in axes of the joint's frame on the farther body.
/// Kinds without axes take the body's frame.
struct RobotCoordinate {
  /// The joint's name, with `/0`, `/1`, `/2` behind it where the joint moves by several
  /// coordinates. Motions without laws have `/linear_x` to `/angular_z` instead, behind the name of
  /// the joint or of the free base.
  std::string name;
  std::optional<JointId> joint;  ///< none: of the free base
  int coordinate = -1;           ///< index in Joint::coordinates; −1: a motion without laws
  bool is_angle = false;         ///< whether in rad instead of m
  /// Position as CoordinateState::position, at the present poses [m or rad]; of a free base the
  /// centre of mass, world frame. NaN for turns by three angles.
  double position = 0.0;
  double velocity = 0.0;  ///< rate [m/s or rad/s]
};

/// Coordinate that follows another one by a gear or a screw: rate = ratio · rate of the leader.
struct RobotFollower {
  JointId joint;
  int coordinate = 0;      ///< index in Joint::coordinates
  std::size_t leader = 0;  ///< index in RobotDynamics::coordinates()
  double ratio = 0.0;      ///< [unit of the follower per unit of the leader]
};

/// Dynamics of a robot at the state of a world, for controllers:
///   M(q) q̈ + b(q, q̇) = τ + p(q, q̇),
/// with forces τ along the coordinates [N or N m], the bias b of Coriolis forces and gravity, and
/// passive forces p of springs and dampers of the joints.
///
/// A robot is all dynamic bodies that acting joints connect with given bodies, directly or by
/// others, and bodies that gears couple with them. Its joints have to form trees, on static or
/// kinematic bodies, or one tree with a free base, which is the body that was added first.
/// Kinematic bases keep their velocity. Motors, limits, friction, contacts and wrenches are left
/// out: coordinates with motors are free, and what a motor does is part of τ. Joints of kind
/// kFreeDistance without laws are left out. Of coordinates that gears or screws couple the first
/// one stays; its τ is the sum over all, by their ratios.
///
/// Coordinates are ordered by the joints in the order of adding, behind a free base. Joints are
/// taken as met: positions and rates are read from the bodies, see pose_error().
///
/// The object is a value, independent of the world; a new state needs a new object. Functions throw
/// std::invalid_argument("FIELD: why, with the value").
class RobotDynamics {
 public:
  /// Reads the robot of a dynamic body, in time linear in the number of joints of the world.
  /// Throws, naming the joint or body, for a body that is unknown or not dynamic, a robot without
  /// coordinates, loops of joints or gears, rods, springs and pulleys between points, functions of
  /// other packages, a joint that is still being closed, and point masses and bodies that only ball
  /// joints at their centre of mass hold.
  RobotDynamics(const World& world, BodyId body);
  /// Reads the robot of several bodies, such as limbs on one static body. At least one body has to
  /// be dynamic; others are ignored. Throws likewise, and for a tree on a free base beside others.
  RobotDynamics(const World& world, const std::vector<BodyId>& bodies);

  /// Number n of coordinates.
  std::size_t size() const { return coordinates().size(); }
  const std::vector<RobotCoordinate>& coordinates() const;
  const std::vector<RobotFollower>& followers() const;
  /// Bodies of the robot in the order of adding.
  const std::vector<BodyId>& bodies() const;
  /// Largest error of a joint: distance [m] plus angle [rad] from where its coordinates put it.
  double pose_error() const;
  /// Positions and velocities of all coordinates.
  Eigen::VectorXd position() const;
  Eigen::VectorXd velocity() const;

  /// M, symmetric and positive definite [kg, kg m or kg m²].
  const Eigen::MatrixXd& mass_matrix() const;
  /// b: Coriolis and centrifugal forces, forces of a moving base, and gravity() [N or N m].
  const Eigen::VectorXd& bias() const;
  /// Forces that carry the weights at rest, with `gravity_compensation` of bodies [N or N m].
  const Eigen::VectorXd& gravity() const;
  /// p: forces of `stiffness` and `damping` of the coordinates [N or N m].
  const Eigen::VectorXd& passive() const;

  /// Motion of a point fixed on a body, in world axes, with linear rows before angular ones:
  /// velocity = J q̇ + base velocity, acceleration = J q̈ + bias.
  struct PointMotion {
    Eigen::Matrix<double, 6, Eigen::Dynamic> J;  ///< by the coordinates
    Eigen::Matrix<double, 6, 1> velocity;        ///< [m/s, rad/s]
    Eigen::Matrix<double, 6, 1> bias;  ///< J̇ q̇ and acceleration of the base [m/s², rad/s²]
  };
  /// Returns the motion of the point at `point` in the body's frame [m]. Its J is the Jacobian of a
  /// frame at that point, whatever the axes of the frame. Throws for a body of another robot and
  /// for numbers that are not finite.
  PointMotion motion_of(BodyId body, const Eigen::Vector3d& point = Eigen::Vector3d::Zero()) const;

  /// Returns τ = M q̈ + b − p for accelerations q̈ [m/s² or rad/s²]. Throws for another number of
  /// entries than n and for numbers that are not finite.
  Eigen::VectorXd inverse_dynamics(const Eigen::VectorXd& acceleration) const;
  /// Returns q̈ = M⁻¹ (τ + p − b) for forces τ [N or N m]. Throws likewise, and where elimination
  /// leaves less than 1e-12 of a diagonal entry of M, so that q̈ would have few digits.
  Eigen::VectorXd forward_dynamics(const Eigen::VectorXd& force) const;

  /// Derivatives of the motion for constant forces: ẋ = A x + B δτ for small x = (δq, δq̇). Changes
  /// δq of turns by three angles are rotation vectors in axes of the farther body (of the free
  /// base), by which its orientation is multiplied from the right.
  struct Linearization {
    Eigen::MatrixXd A;             ///< 2n × 2n
    Eigen::MatrixXd B;             ///< 2n × n
    Eigen::VectorXd acceleration;  ///< q̈ [m/s² or rad/s²]
  };
  /// Returns the derivatives at the present state and forces τ, analytically. Throws as
  /// forward_dynamics().
  Linearization linearize(const Eigen::VectorXd& force) const;

 private:
  struct Impl;
  std::shared_ptr<const Impl> impl_;
};

}  // namespace constraint_sim::engine
