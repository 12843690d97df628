#pragma once

#include <constraint_sim/ApplyBodyWrench.h>
#include <constraint_sim/BodyState.h>
#include <constraint_sim/ContactForce.h>
#include <constraint_sim/ContactState.h>
#include <geometry_msgs/Point.h>
#include <geometry_msgs/Pose.h>
#include <geometry_msgs/Transform.h>
#include <geometry_msgs/Twist.h>
#include <geometry_msgs/Vector3.h>
#include <sensor_msgs/JointState.h>

#include <string>

#include "constraint_sim/engine/world.h"
#include "constraint_sim/engine/wrench.h"

namespace constraint_sim {

// Conversions between messages and the engine. Fields left at zero take the default that the
// message's documentation states. Invalid values throw std::invalid_argument that names field and
// value.

Eigen::Vector3d from_msg(const geometry_msgs::Point& point);
Eigen::Vector3d from_msg(const geometry_msgs::Vector3& vector);
/// Reads a quaternion; all zero is the identity.
Eigen::Quaterniond from_msg(const geometry_msgs::Quaternion& quaternion);
engine::BodyState from_msg(const geometry_msgs::Pose& pose, const geometry_msgs::Twist& twist);

/// Finds a body by name; empty and `world` are the world. `field` names the body in errors.
engine::BodyId find_body(const engine::World& world, const std::string& field,
                         const std::string& name);
/// Finds a body by name, and rejects the world itself.
engine::BodyId find_own_body(const engine::World& world, const std::string& field,
                             const std::string& name);
engine::JointId find_joint(const engine::World& world, const std::string& field,
                           const std::string& name);
/// Reads a wrench. A moving reference frame is evaluated at the present time. A zero reference
/// point is the body's centre of mass; any other point lies in the reference frame.
engine::Wrench from_msg(const ApplyBodyWrenchRequest& request, const engine::World& world);

/// Converts a state between the world's frame and the frame of a moving body. Relative velocities
/// are those seen by an observer who moves and turns with the frame: a body fixed to the frame has
/// none. Throws where the result is out of range.
engine::BodyState relative_to(const engine::BodyState& frame, const engine::BodyState& in_world);
engine::BodyState from_relative(const engine::BodyState& frame, const engine::BodyState& relative);

/// Clamps to the largest finite double; not-a-number becomes that number too.
double finite(double value);
geometry_msgs::Point to_point(const Eigen::Vector3d& v);
geometry_msgs::Vector3 to_vector(const Eigen::Vector3d& v);
geometry_msgs::Quaternion to_msg(const Eigen::Quaterniond& q);
geometry_msgs::Pose to_pose(const engine::BodyState& state);
geometry_msgs::Transform to_transform(const engine::BodyState& state);
BodyState to_msg(const std::string& name, const engine::BodyState& state);
/// Appends the coordinates of a joint with the efforts of their actuators: the first under the
/// joint's name, further ones under NAME/INDEX. Appends nothing for a joint without coordinates.
void add_coordinates(const engine::Joint& joint, const engine::JointState& state,
                     const std::array<double, engine::kMaxCoordinates>& efforts,
                     sensor_msgs::JointState* msg);
ContactState to_msg(const engine::World& world, const engine::Contact& contact);
/// Returns the contact force with the present velocities of both bodies.
ContactForce to_force_msg(const engine::World& world, const engine::Contact& contact);

}  // namespace constraint_sim
