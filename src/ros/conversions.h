#pragma once

#include <constraint_sim/AddDistanceConstraint.h>
#include <constraint_sim/Body.h>
#include <constraint_sim/BodyState.h>
#include <constraint_sim/ConstraintState.h>
#include <constraint_sim/Shape.h>
#include <geometry_msgs/Point.h>
#include <geometry_msgs/Pose.h>
#include <geometry_msgs/Transform.h>
#include <geometry_msgs/Twist.h>
#include <geometry_msgs/Vector3.h>

#include <string>

#include "constraint_sim/world.h"

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
engine::JointId find_joint(const engine::World& world, const std::string& field,
                           const std::string& name);
engine::Joint from_msg(const AddDistanceConstraintRequest& request, const engine::World& world);

geometry_msgs::Point to_point(const Eigen::Vector3d& v);
geometry_msgs::Vector3 to_vector(const Eigen::Vector3d& v);
geometry_msgs::Quaternion to_msg(const Eigen::Quaterniond& q);
geometry_msgs::Pose to_pose(const engine::BodyState& state);
geometry_msgs::Transform to_transform(const engine::BodyState& state);
BodyState to_msg(const std::string& name, const engine::BodyState& state);
ConstraintState to_msg(const engine::Joint& joint, const engine::JointState& state);

}  // namespace constraint_sim
