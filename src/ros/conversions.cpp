#include "ros/conversions.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>
#include <set>
#include <stdexcept>
#include <utility>

#include "ros/laws.h"
#include "sim/errors.h"

namespace constraint_sim {
namespace {

Eigen::Vector3d finite_vector(const char* field, const Eigen::Vector3d& v) {
  if (!v.allFinite())
    refuse(field, "must be finite numbers, got (" + std::to_string(v.x()) + ", " +
                      std::to_string(v.y()) + ", " + std::to_string(v.z()) + ")");
  return v;
}

void check_dimensions(const Shape& shape, const char* meaning, std::size_t count) {
  if (shape.dimensions.size() != count)
    refuse("shape.dimensions", std::string("a ") + meaning + ", got " +
                                   std::to_string(shape.dimensions.size()) + " numbers");
}

Eigen::Vector3d anchor_in_world(const engine::World& world, engine::BodyId body,
                                const Eigen::Vector3d& anchor) {
  const engine::BodyState& state = world.state(body);
  return state.position + state.orientation * anchor;
}

// Rejects fields that the type does not use: a user would believe that they act.
void check_left_out(const Constraint& msg, std::initializer_list<const char*> used) {
  const std::pair<const char*, double> settings[] = {
      {"length", std::max(msg.length, 0.0)},   {"min_length", msg.min_length},
      {"max_length", msg.max_length},          {"frequency", msg.frequency},
      {"damping_ratio", msg.damping_ratio},    {"axis_a", from_msg(msg.axis_a).norm()},
      {"axis_b", from_msg(msg.axis_b).norm()},
  };
  for (const auto& setting : settings) {
    const std::string field = setting.first;
    const bool is_used = std::find(used.begin(), used.end(), field) != used.end();
    if (!is_used && setting.second != 0.0)
      refuse(field, "constraints of type '" + msg.type + "' have none, got " +
                        std::to_string(setting.second));
  }
}

void check_keys(const Constraint& msg) {
  if (msg.keys.size() != msg.values.size())
    refuse("values", "must be as many as keys, got " + std::to_string(msg.values.size()) + " for " +
                         std::to_string(msg.keys.size()));
  std::set<std::string> seen;
  for (const std::string& key : msg.keys)
    if (!seen.insert(key).second) refuse("keys", "'" + key + "' is there twice");
}

// Reads the keys of constraint types without coordinates.
void read_keys(const Constraint& msg, engine::Joint& joint) {
  auto* distance = engine::if_distance(joint);
  for (std::size_t i = 0; i < msg.keys.size(); ++i) {
    const std::string& key = msg.keys[i];
    if (key == "timeout")
      joint.motor.timeout = msg.values[i];
    else if (key == "stiffness" && (msg.type == "spring" || msg.type == "rope"))
      distance->stiffness = msg.values[i];
    else if (key == "damping" && (msg.type == "spring" || msg.type == "rope"))
      distance->damping = msg.values[i];
    else if (key == "one_sided" && msg.type == "spring")
      distance->one_sided = flag(msg.values[i], "one_sided");
    else if (key == "one_sided" && engine::couples_lengths(joint.kind))
      joint.coupling.one_sided = flag(msg.values[i], "one_sided");
    else if (key == "break_torque" && distance == nullptr)
      joint.break_torque = msg.values[i];
    else if (key == "ratio" && engine::couples_joints(joint.kind))
      joint.coupling.ratio = msg.values[i];
    else if (key == "value" && engine::couples(joint.kind))
      joint.coupling.value = msg.values[i];
    else if (key == "free" && distance != nullptr && msg.type == "distance" && msg.values[i] == 0.0)
      continue;
    else
      refuse("keys", "constraints of type '" + msg.type + "' have no '" + key + "'");
  }
}

// Returns the length in the message; nullopt, the present distance, for zero and below.
std::optional<double> length_of(const Constraint& msg) {
  if (!std::isfinite(msg.length))
    refuse("length", "must be a finite number, got " + std::to_string(msg.length));
  return msg.length > 0.0 ? std::optional<double>(msg.length) : std::nullopt;
}

// Builds a distance joint from `distance` or its shorthands `rope`, `strut` and `spring`.
engine::DistanceJoint distance_joint(const Constraint& msg, double present_distance) {
  engine::DistanceJoint distance;
  if (msg.type == "distance") {
    check_left_out(msg, {"length", "min_length", "max_length", "frequency", "damping_ratio"});
    distance.length = length_of(msg);
    distance.min_length = msg.min_length;
    if (msg.max_length != 0.0) distance.max_length = msg.max_length;
  } else if (msg.type == "rope") {
    check_left_out(msg, {"max_length", "frequency", "damping_ratio"});
    distance.max_length = msg.max_length != 0.0 ? msg.max_length : present_distance;
  } else if (msg.type == "strut") {
    check_left_out(msg, {"min_length"});
    distance.min_length = msg.min_length != 0.0 ? msg.min_length : present_distance;
  } else if (msg.type == "spring") {
    check_left_out(msg, {"length", "frequency", "damping_ratio"});
    distance.length = length_of(msg);
  } else {
    refuse("type", "there is no '" + msg.type + "' (yet); there are distance, rope, strut, spring" +
                       engine::names_of_further_kinds() +
                       "; custom: and custom_force: go before the type of a plugin");
  }
  distance.frequency = msg.frequency;
  distance.damping_ratio = msg.damping_ratio;
  return distance;
}

// Reads the axes. A zero axis_a means z of body A; a zero axis_b means that axis B coincides with
// axis A in the present poses.
void read_axes(const Constraint& msg, engine::Joint* joint) {
  if (!engine::has_frames(joint->kind)) return check_left_out(msg, {});
  if (engine::coordinates(joint->kind) > 0)
    check_left_out(msg, {"axis_a", "axis_b", "frequency", "damping_ratio"});
  else
    check_left_out(msg, {"axis_a", "axis_b"});
  const Eigen::Vector3d axis_a = finite_vector("axis_a", from_msg(msg.axis_a));
  const Eigen::Vector3d axis_b = finite_vector("axis_b", from_msg(msg.axis_b));
  if (!axis_a.isZero(0.0)) joint->frame_a = engine::frame_along(axis_a);
  if (!axis_b.isZero(0.0)) joint->axis_b = axis_b;
}

constexpr std::uint8_t kCylinder = 5;  // a constant in Shape.msg would change its checksum

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
    case kCylinder:
      check_dimensions(shape, "cylinder has two: radius, length", 2);
      return engine::Cylinder{size[0], size[1]};
    default:
      refuse("shape.type", "must be POINT=0, SPHERE=1, BOX=2, PLANE=4 or 5, a cylinder, got " +
                               std::to_string(shape.type));
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

namespace {

// Reads a gear or pulley: its fields for bodies name constraints.
engine::Joint coupling_between(const Constraint& msg, const engine::World& world) {
  engine::Joint joint;
  joint.name = msg.name;
  const auto find = [&](const char* field, const std::string& name) {
    if (!world.has_joint(name)) refuse(field, "there is no constraint '" + name + "'");
    return world.find_joint(name);
  };
  joint.coupling.first = find("body_a", msg.body_a);
  joint.coupling.second = find("body_b", msg.body_b);
  const Eigen::Vector3d none = Eigen::Vector3d::Zero();
  for (const auto& [field, value] :
       {std::pair("anchor_a", from_msg(msg.anchor_a)), {"anchor_b", from_msg(msg.anchor_b)}})
    if (value != none) refuse(field, "constraints of type '" + msg.type + "' have none");
  return joint;
}

// Returns the joint kind. `distance` with the key `free` is a kind of its own.
engine::JointKind kind_of(const Constraint& msg) {
  const auto free = std::find(msg.keys.begin(), msg.keys.end(), "free");
  const bool is_free = msg.type == "distance" && free != msg.keys.end();
  const auto i = static_cast<std::size_t>(free - msg.keys.begin());
  if (is_free && i < msg.values.size() && msg.values[i] == 1.0) return engine::free_length();
  return engine::joint_kind_named(msg.type.substr(0, msg.type.find(':')))
      .value_or(engine::Joint{}.kind);
}

// Reads a constraint of a plugin: its type stands after a colon, and all keys are parameters of the
// plugin.
void read_custom(const Constraint& msg, engine::Joint* joint) {
  const std::size_t colon = msg.type.find(':');
  if (colon != std::string::npos) joint->custom.type = msg.type.substr(colon + 1);
  for (std::size_t i = 0; i < msg.keys.size(); ++i)
    joint->custom.parameters.push_back({msg.keys[i], msg.values[i]});
}

/// Returns a joint with the name and the ends, which both constraint messages have.
template <class Message>
engine::Joint joint_between(const Message& message, const engine::World& world) {
  engine::Joint joint;
  joint.name = message.name;
  joint.body_a = find_body(world, "body_a", message.body_a);
  joint.anchor_a = from_msg(message.anchor_a);
  joint.body_b = find_body(world, "body_b", message.body_b);
  joint.anchor_b = from_msg(message.anchor_b);
  return joint;
}

}  // namespace

engine::Joint from_msg(const AddDistanceConstraintRequest& request, const engine::World& world) {
  if (!std::isfinite(request.length))
    refuse("length", "must be a finite number, got " + std::to_string(request.length));
  engine::Joint joint = joint_between(request, world);
  engine::DistanceJoint distance;
  if (request.length > 0.0) distance.length = request.length;
  joint.distance = distance;
  return joint;
}

engine::Joint from_msg(const Constraint& msg, const engine::World& world) {
  const engine::JointKind kind = kind_of(msg);
  engine::Joint joint =
      engine::couples_joints(kind) ? coupling_between(msg, world) : joint_between(msg, world);
  joint.kind = kind;
  if (engine::if_distance(joint) == nullptr)
    read_axes(msg, &joint);
  else
    joint.distance = distance_joint(msg, (anchor_in_world(world, joint.body_b, joint.anchor_b) -
                                          anchor_in_world(world, joint.body_a, joint.anchor_a))
                                             .norm());
  check_keys(msg);
  if (engine::is_custom(joint.kind)) {
    read_custom(msg, &joint);
  } else if (msg.type.find(':') != std::string::npos) {
    refuse("type", "only custom: and custom_force: have a type after them, got '" + msg.type + "'");
  } else if (engine::coordinates(joint.kind) > 0) {
    read_laws(msg, &joint);
  } else {
    joint.motor = {msg.bias, msg.amplitude, msg.motor_frequency, msg.phase, msg.max_force, 0.0};
    read_keys(msg, joint);
  }
  if (msg.baumgarte != 0.0) joint.baumgarte = msg.baumgarte;
  joint.break_force = msg.break_force;
  joint.collide_connected = msg.collide_connected;
  auto* distance = engine::if_distance(joint);
  if (msg.type == "rope" && distance->is_soft()) *distance = engine::tension_spring(*distance);
  if (msg.type == "spring" && !distance->is_soft())
    refuse("frequency",
           "a spring needs one, or stiffness or damping, got " + std::to_string(msg.frequency));
  return joint;
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

ConstraintState to_msg(const engine::Joint& joint, const engine::JointState& state) {
  ConstraintState msg;
  msg.name = joint.name;
  msg.type = engine::name(joint.kind);
  msg.error = finite(state.error);
  msg.error_rate = finite(state.error_rate);
  msg.force = finite(state.force);
  msg.bias = finite(state.bias);
  msg.reached_rate = finite(state.reached_rate);
  msg.saturated = state.saturated;
  msg.broken = state.broken;
  msg.closing = state.closing;
  return msg;
}

void add_coordinates(const engine::Joint& joint, const engine::JointState& state,
                     sensor_msgs::JointState* msg) {
  for (int i = 0; i < engine::coordinates(joint.kind); ++i) {
    const engine::CoordinateState& coordinate = state.coordinates[static_cast<std::size_t>(i)];
    msg->name.push_back(i == 0 ? joint.name : joint.name + "/" + std::to_string(i));
    msg->position.push_back(finite(coordinate.position));
    msg->velocity.push_back(finite(coordinate.velocity));
    msg->effort.push_back(finite(coordinate.effort));
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
