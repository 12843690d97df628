#include "ros/conversions.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>
#include <utility>

#include "sim/errors.h"

namespace constraint_sim {
namespace {

Eigen::Vector3d finite_vector(const char* field, const Eigen::Vector3d& v) {
  if (!v.allFinite())
    refuse(field, "must be finite numbers, got (" + std::to_string(v.x()) + ", " +
                      std::to_string(v.y()) + ", " + std::to_string(v.z()) + ")");
  return v;
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

engine::BodyId find_own_body(const engine::World& world, const std::string& field,
                             const std::string& name) {
  const engine::BodyId id = find_body(world, field, name);
  if (id == engine::kWorldBody) refuse(field, "must name a body of the scene, got '" + name + "'");
  return id;
}

engine::JointId find_joint(const engine::World& world, const std::string& field,
                           const std::string& name) {
  if (!world.has_joint(name)) refuse(field, "there is no constraint named '" + name + "'");
  return world.find_joint(name);
}

engine::Wrench from_msg(const ApplyBodyWrenchRequest& request, const engine::World& world) {
  engine::Wrench wrench;
  wrench.body = find_own_body(world, "body_name", request.body_name);
  const engine::BodyState& frame =
      world.state(find_body(world, "reference_frame", request.reference_frame));
  // Non-finite numbers are rejected first: the rotation below would hide which component was wrong.
  const Eigen::Vector3d point = finite_vector("reference_point", from_msg(request.reference_point));
  wrench.force = frame.orientation * finite_vector("force", from_msg(request.wrench.force));
  wrench.torque = frame.orientation * finite_vector("torque", from_msg(request.wrench.torque));
  if (!point.isZero(0.0)) {
    const Eigen::Vector3d p_W = frame.position + frame.orientation * point;
    wrench.torque += (p_W - world.state(wrench.body).position).cross(wrench.force);
  }
  wrench.start = std::max(request.start_time.toSec(), world.time());
  const double duration = request.duration.toSec();
  if (duration > 0.0)
    wrench.end = wrench.start + duration;
  else if (duration == 0.0)
    wrench.end = wrench.start + world.options().time_step;
  return wrench;
}

engine::BodyState relative_to(const engine::BodyState& frame, const engine::BodyState& in_world) {
  const Eigen::Quaterniond R = frame.orientation.conjugate();
  const Eigen::Vector3d r = in_world.position - frame.position;
  engine::BodyState relative;
  relative.position = R * r;
  relative.orientation = R * in_world.orientation;
  relative.linear_velocity =
      R * (in_world.linear_velocity - frame.linear_velocity - frame.angular_velocity.cross(r));
  relative.angular_velocity = R * (in_world.angular_velocity - frame.angular_velocity);
  engine::validate(relative);
  return relative;
}

engine::BodyState from_relative(const engine::BodyState& frame, const engine::BodyState& relative) {
  const Eigen::Quaterniond& R = frame.orientation;
  const Eigen::Vector3d r = R * relative.position;
  engine::BodyState in_world;
  in_world.position = frame.position + r;
  in_world.orientation = R * relative.orientation;
  in_world.linear_velocity =
      frame.linear_velocity + frame.angular_velocity.cross(r) + R * relative.linear_velocity;
  in_world.angular_velocity = frame.angular_velocity + R * relative.angular_velocity;
  return in_world;
}

double finite(double value) {
  constexpr double kMost = std::numeric_limits<double>::max();
  return value >= -kMost ? std::min(value, kMost) : value < 0.0 ? -kMost : kMost;
}

geometry_msgs::Point to_point(const Eigen::Vector3d& v) {
  geometry_msgs::Point msg;
  msg.x = finite(v.x());
  msg.y = finite(v.y());
  msg.z = finite(v.z());
  return msg;
}

geometry_msgs::Vector3 to_vector(const Eigen::Vector3d& v) {
  geometry_msgs::Vector3 msg;
  msg.x = finite(v.x());
  msg.y = finite(v.y());
  msg.z = finite(v.z());
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

void add_coordinates(const engine::Joint& joint, const engine::JointState& state,
                     const std::array<double, engine::kMaxCoordinates>& efforts,
                     sensor_msgs::JointState* msg) {
  for (int i = 0; i < engine::info(joint.kind).coordinates; ++i) {
    const engine::CoordinateState& coordinate = state.coordinates[static_cast<std::size_t>(i)];
    msg->name.push_back(i == 0 ? joint.name : joint.name + "/" + std::to_string(i));
    msg->position.push_back(finite(coordinate.position));
    msg->velocity.push_back(finite(coordinate.velocity));
    msg->effort.push_back(finite(efforts[static_cast<std::size_t>(i)]));
  }
}

ContactState to_msg(const engine::World& world, const engine::Contact& contact) {
  ContactState msg;
  msg.body_a = world.body(contact.body_a).name;
  msg.body_b = world.body(contact.body_b).name;
  msg.position = to_point(contact.position);
  msg.normal = to_vector(contact.normal);
  msg.depth = finite(contact.depth);
  msg.normal_force = finite(contact.normal_force);
  return msg;
}

ContactForce to_force_msg(const engine::World& world, const engine::Contact& contact) {
  const auto velocity = [&](engine::BodyId id) -> Eigen::Vector3d {
    const engine::BodyState& state = world.state(id);
    return state.linear_velocity + state.angular_velocity.cross(contact.position - state.position);
  };
  const Eigen::Vector3d v = velocity(contact.body_a) - velocity(contact.body_b);
  ContactForce msg;
  msg.body_a = world.body(contact.body_a).name;
  msg.body_b = world.body(contact.body_b).name;
  msg.position = to_point(contact.position);
  msg.normal = to_vector(contact.normal);
  msg.force = to_vector(contact.force);
  msg.slip_velocity = to_vector(v - v.dot(contact.normal) * contact.normal);
  msg.gap = -finite(contact.depth);
  msg.state = static_cast<std::uint8_t>(contact.state);
  return msg;
}

static_assert(ContactForce::CLOSED == static_cast<int>(engine::ContactState::kClosed));
static_assert(ContactForce::STICKING == static_cast<int>(engine::ContactState::kSticking));
static_assert(ContactForce::SLIPPING == static_cast<int>(engine::ContactState::kSlipping));

}  // namespace constraint_sim
