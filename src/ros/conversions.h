#pragma once

#include <constraint_sim/AddDistanceConstraint.h>
#include <constraint_sim/ApplyBodyWrench.h>
#include <constraint_sim/Body.h>
#include <constraint_sim/BodyState.h>
#include <constraint_sim/Constraint.h>
#include <constraint_sim/ConstraintState.h>
#include <constraint_sim/ContactForce.h>
#include <constraint_sim/ContactState.h>
#include <constraint_sim/Shape.h>
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

// Between messages and the engine. From a message: what a message leaves out (all zero) takes its
// meaning from the contract, and what cannot be throws std::invalid_argument naming field and
// value.

Eigen::Vector3d from_msg(const geometry_msgs::Point& point);
Eigen::Vector3d from_msg(const geometry_msgs::Vector3& vector);
/// All zero, as when left out, is the identity.
Eigen::Quaterniond from_msg(const geometry_msgs::Quaternion& quaternion);
engine::Shape from_msg(const Shape& shape);
engine::Body from_msg(const Body& body);
engine::BodyState from_msg(const geometry_msgs::Pose& pose, const geometry_msgs::Twist& twist);

/// `field` names the body in errors; empty and `world` are the world.
engine::BodyId find_body(const engine::World& world, const std::string& field,
                         const std::string& name);
/// The same where the world itself does not do.
engine::BodyId find_own_body(const engine::World& world, const std::string& field,
                             const std::string& name);
engine::JointId find_joint(const engine::World& world, const std::string& field,
                           const std::string& name);
engine::Joint from_msg(const AddDistanceConstraintRequest& request, const engine::World& world);

engine::Joint from_msg(const Constraint& constraint, const engine::World& world);
/// As of now: a frame that moves is taken as it is at this moment. A reference point left out
/// (zero) is the body's centre of mass; otherwise it lies in the reference frame.
engine::Wrench from_msg(const ApplyBodyWrenchRequest& request, const engine::World& world);

/// A state in the world as seen from the frame of a moving body, and back. Velocities are those
/// that an observer who moves and turns with the frame sees: a body fixed to it has none. Throws
/// where the numbers are beyond their range.
engine::BodyState relative_to(const engine::BodyState& frame, const engine::BodyState& in_world);
engine::BodyState from_relative(const engine::BodyState& frame, const engine::BodyState& relative);

/// What messages have for a number: itself, or the largest there is for what is beyond the range or
/// no number at all.
double finite(double value);
geometry_msgs::Point to_point(const Eigen::Vector3d& v);
geometry_msgs::Vector3 to_vector(const Eigen::Vector3d& v);
geometry_msgs::Quaternion to_msg(const Eigen::Quaterniond& q);
geometry_msgs::Pose to_pose(const engine::BodyState& state);
geometry_msgs::Transform to_transform(const engine::BodyState& state);
BodyState to_msg(const std::string& name, const engine::BodyState& state);
ConstraintState to_msg(const engine::Joint& joint, const engine::JointState& state);
/// Adds the coordinates of a joint, the first under its name and further ones under NAME/INDEX; of
/// a joint without coordinates nothing.
void add_coordinates(const engine::Joint& joint, const engine::JointState& state,
                     sensor_msgs::JointState* msg);
ContactState to_msg(const engine::World& world, const engine::Contact& contact);
/// With how the two bodies move now.
ContactForce to_force_msg(const engine::World& world, const engine::Contact& contact);

}  // namespace constraint_sim
