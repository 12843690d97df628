#include "ros/conversions.h"

#include <cmath>
#include <stdexcept>

namespace constraint_sim {
namespace {

[[noreturn]] void refuse(const std::string& field, const std::string& why) {
  throw std::invalid_argument(field + ": " + why);
}

void check_dimensions(const Shape& shape, const char* meaning, std::size_t count) {
  if (shape.dimensions.size() != count)
    refuse("shape.dimensions", std::string("a ") + meaning + ", got " +
                                   std::to_string(shape.dimensions.size()) + " numbers");
}

engine::BodyType body_type(std::uint8_t type) {
  switch (type) {
    case Body::DYNAMIC:
      return engine::BodyType::kDynamic;
    case Body::STATIC:
      return engine::BodyType::kStatic;
    case Body::KINEMATIC:
      return engine::BodyType::kKinematic;
    default:
      refuse("type", "must be DYNAMIC=0, STATIC=1 or KINEMATIC=2, got " + std::to_string(type));
  }
}

}  // namespace

Eigen::Vector3d from_msg(const geometry_msgs::Point& point) { return {point.x, point.y, point.z}; }

Eigen::Vector3d from_msg(const geometry_msgs::Vector3& vector) {
  return {vector.x, vector.y, vector.z};
}

Eigen::Quaterniond from_msg(const geometry_msgs::Quaternion& q) {
  if (q.x == 0.0 && q.y == 0.0 && q.z == 0.0 && q.w == 0.0) return Eigen::Quaterniond::Identity();
  return {q.w, q.x, q.y, q.z};
}

engine::Shape from_msg(const Shape& shape) {
  const auto& size = shape.dimensions;
  switch (shape.type) {
    case Shape::POINT:
      check_dimensions(shape, "point has no dimensions", 0);
      return engine::Point{};
    case Shape::SPHERE:
      check_dimensions(shape, "sphere has one: its radius", 1);
      return engine::Sphere{size[0]};
    case Shape::BOX:
      check_dimensions(shape, "box has three: x, y, z", 3);
      return engine::Box{{size[0], size[1], size[2]}};
    case Shape::CAPSULE:
      refuse("shape.type", "capsules do not exist yet, got CAPSULE=3");
    case Shape::PLANE:
      check_dimensions(shape, "plane has no dimensions", 0);
      return engine::Plane{};
    default:
      refuse("shape.type",
             "must be POINT=0, SPHERE=1, BOX=2 or PLANE=4, got " + std::to_string(shape.type));
  }
}

engine::Body from_msg(const Body& msg) {
  engine::Body body;
  body.name = msg.name;
  body.type = body_type(msg.type);
  body.shape = from_msg(msg.shape);
  body.mass = msg.mass;
  body.inertia = from_msg(msg.inertia);
  body.state = from_msg(msg.pose, msg.twist);
  body.friction = msg.friction;
  body.restitution = msg.restitution;
  body.no_collision = msg.no_collision;
  return body;
}

engine::BodyState from_msg(const geometry_msgs::Pose& pose, const geometry_msgs::Twist& twist) {
  engine::BodyState state;
  state.position = from_msg(pose.position);
  state.orientation = from_msg(pose.orientation);
  state.linear_velocity = from_msg(twist.linear);
  state.angular_velocity = from_msg(twist.angular);
  return state;
}

engine::BodyId find_body(const engine::World& world, const std::string& field,
                         const std::string& name) {
  if (name.empty()) return engine::kWorldBody;
  if (!world.has_body(name)) refuse(field, "there is no body named '" + name + "'");
  return world.find_body(name);
}

engine::JointId find_joint(const engine::World& world, const std::string& field,
                           const std::string& name) {
  if (!world.has_joint(name)) refuse(field, "there is no constraint named '" + name + "'");
  return world.find_joint(name);
}

engine::Joint from_msg(const AddDistanceConstraintRequest& request, const engine::World& world) {
  if (!std::isfinite(request.length))
    refuse("length", "must be a finite number, got " + std::to_string(request.length));
  engine::Joint joint;
  joint.name = request.name;
  joint.body_a = find_body(world, "body_a", request.body_a);
  joint.anchor_a = from_msg(request.anchor_a);
  joint.body_b = find_body(world, "body_b", request.body_b);
  joint.anchor_b = from_msg(request.anchor_b);
  engine::DistanceJoint distance;
  if (request.length > 0.0) distance.length = request.length;
  joint.type = distance;
  return joint;
}

geometry_msgs::Point to_point(const Eigen::Vector3d& v) {
  geometry_msgs::Point msg;
  msg.x = v.x();
  msg.y = v.y();
  msg.z = v.z();
  return msg;
}

geometry_msgs::Vector3 to_vector(const Eigen::Vector3d& v) {
  geometry_msgs::Vector3 msg;
  msg.x = v.x();
  msg.y = v.y();
  msg.z = v.z();
  return msg;
}

geometry_msgs::Quaternion to_msg(const Eigen::Quaterniond& q) {
  geometry_msgs::Quaternion msg;
  msg.x = q.x();
  msg.y = q.y();
  msg.z = q.z();
  msg.w = q.w();
  return msg;
}

geometry_msgs::Pose to_pose(const engine::BodyState& state) {
  geometry_msgs::Pose msg;
  msg.position = to_point(state.position);
  msg.orientation = to_msg(state.orientation);
  return msg;
}

geometry_msgs::Transform to_transform(const engine::BodyState& state) {
  geometry_msgs::Transform msg;
  msg.translation = to_vector(state.position);
  msg.rotation = to_msg(state.orientation);
  return msg;
}

BodyState to_msg(const std::string& name, const engine::BodyState& state) {
  BodyState msg;
  msg.name = name;
  msg.pose = to_pose(state);
  msg.twist.linear = to_vector(state.linear_velocity);
  msg.twist.angular = to_vector(state.angular_velocity);
  return msg;
}

ConstraintState to_msg(const engine::Joint& joint, const engine::JointState& state) {
  ConstraintState msg;
  msg.name = joint.name;
  msg.type = engine::type_name(joint.type);
  msg.error = state.error;
  msg.error_rate = state.error_rate;
  msg.force = state.force;
  msg.bias = state.bias;
  msg.reached_rate = state.reached_rate;
  msg.saturated = state.saturated;
  msg.broken = state.broken;
  msg.closing = state.closing;
  return msg;
}

}  // namespace constraint_sim
