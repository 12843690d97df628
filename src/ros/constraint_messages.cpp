#include "ros/constraint_messages.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <initializer_list>
#include <optional>
#include <set>
#include <stdexcept>
#include <string>
#include <utility>

#include "ros/conversions.h"
#include "sim/errors.h"

namespace constraint_sim {
namespace {

using Figures = std::initializer_list<std::pair<const char*, double>>;

/// Rejects figures that are not 0: a user would believe that they act.
void check_zero(const std::string& prefix, const std::string& why, Figures figures) {
  for (const auto& [field, value] : figures)
    if (value != 0.0) refuse(prefix + field, why + ", got " + std::to_string(value));
}

template <class Law>
void validate_as(const std::string& prefix, const Law& law) {
  try {
    engine::validate(law);
  } catch (const std::invalid_argument& error) {
    throw std::invalid_argument(prefix + error.what());
  }
}

std::string of_type(const Constraint& msg) { return "constraints of type '" + msg.type + "'"; }

// ---- motors and laws

/// Rejects figures that the mode of the motor does not have.
void check_mode(const std::string& prefix, const Motor& msg) {
  if (msg.mode > Motor::FORCE)
    refuse(prefix + "mode",
           "must be NONE=0, RATE=1, POSITION=2 or FORCE=3, got " + std::to_string(msg.mode));
  const auto check = [&](std::uint8_t mode, const char* name, Figures figures) {
    if (msg.mode != mode)
      check_zero(prefix, std::string("only a motor of mode ") + name + " has this", figures);
  };
  check(Motor::RATE, "RATE=1",
        {{"bias", msg.bias},
         {"amplitude", msg.amplitude},
         {"frequency", msg.frequency},
         {"phase", msg.phase}});
  check(Motor::POSITION, "POSITION=2",
        {{"position", msg.position},
         {"servo_frequency", msg.servo_frequency},
         {"servo_damping_ratio", msg.servo_damping_ratio},
         {"servo_stiffness", msg.servo_stiffness},
         {"servo_damping", msg.servo_damping}});
  check(Motor::FORCE, "FORCE=3", {{"force", msg.force}});
  if (msg.mode == Motor::NONE)
    check_zero(prefix, "needs a mode of the motor",
               {{"max_force", msg.max_force}, {"timeout", msg.timeout}});
}

std::optional<engine::Motor> motor_of(const std::string& prefix, const Motor& msg) {
  check_mode(prefix, msg);
  if (msg.mode == Motor::NONE) return std::nullopt;
  engine::Motor motor;
  motor.bias = msg.bias;
  motor.amplitude = msg.amplitude;
  motor.frequency = msg.frequency;
  motor.phase = msg.phase;
  motor.max_force = msg.max_force;
  motor.timeout = msg.timeout;
  if (msg.mode == Motor::FORCE) motor.force = msg.force;
  if (msg.mode != Motor::POSITION) return motor;
  motor.position = msg.position;
  motor.servo_frequency = msg.servo_frequency;
  if (msg.servo_damping_ratio != 0.0) motor.servo_damping_ratio = msg.servo_damping_ratio;
  motor.servo_stiffness = msg.servo_stiffness;
  motor.servo_damping = msg.servo_damping;
  return motor;
}

engine::CoordinateLaw law_of(const std::string& prefix, const CoordinateLaw& msg) {
  engine::CoordinateLaw law;
  law.motor = motor_of(prefix + "motor.", msg.motor);
  law.frequency = msg.frequency;
  law.damping_ratio = msg.damping_ratio;
  law.stiffness = msg.stiffness;
  law.damping = msg.damping;
  law.rest = msg.rest;
  law.limit_restitution = msg.limit_restitution;
  law.friction = msg.friction;
  law.zero = msg.zero;
  if (msg.has_limits) {
    law.lower = msg.lower;
    law.upper = msg.upper;
  } else {
    check_zero(prefix, "needs has_limits", {{"lower", msg.lower}, {"upper", msg.upper}});
  }
  if (msg.has_position) {
    law.position = msg.position;
    check_zero(prefix, "has_position already gives the value", {{"zero", msg.zero}});
  } else {
    check_zero(prefix, "needs has_position", {{"position", msg.position}});
  }
  validate_as(prefix, law);
  return law;
}

/// Reads the law of the length of a distance: a spring, and a motor by rate.
void read_law_of_length(const Constraint& msg, engine::Joint* joint) {
  if (msg.coordinates.empty()) return;
  const CoordinateLaw& law = msg.coordinates[0];
  const std::string prefix = "coordinates[0].";
  check_zero(prefix, of_type(msg) + " have none",
             {{"rest", law.rest},
              {"has_limits", law.has_limits ? 1.0 : 0.0},
              {"lower", law.lower},
              {"upper", law.upper},
              {"limit_restitution", law.limit_restitution},
              {"friction", law.friction},
              {"has_position", law.has_position ? 1.0 : 0.0},
              {"position", law.position},
              {"zero", law.zero}});
  if (msg.type == "strut")
    check_zero(prefix, of_type(msg) + " have none",
               {{"frequency", law.frequency},
                {"damping_ratio", law.damping_ratio},
                {"stiffness", law.stiffness},
                {"damping", law.damping}});
  joint->distance.frequency = law.frequency;
  joint->distance.damping_ratio = law.damping_ratio;
  joint->distance.stiffness = law.stiffness;
  joint->distance.damping = law.damping;
  if (msg.type == "rope" && joint->distance.is_soft())
    joint->distance = engine::tension_spring(joint->distance);
  const std::optional<engine::Motor> motor = motor_of(prefix + "motor.", law.motor);
  if (!motor) return;
  if (law.motor.mode != Motor::RATE)
    refuse(prefix + "motor.mode", of_type(msg) + " have motors of mode RATE=1 alone, got " +
                                      std::to_string(law.motor.mode));
  joint->motor = *motor;
  validate_as(prefix + "motor.", joint->motor);
}

void read_laws(const Constraint& msg, engine::Joint* joint) {
  const bool is_distance = engine::if_distance(*joint) != nullptr;
  const auto most = is_distance ? std::size_t{1}
                                : static_cast<std::size_t>(engine::info(joint->kind).coordinates);
  if (msg.coordinates.size() > most)
    refuse("coordinates", of_type(msg) + " have " + std::to_string(most) +
                              (most == 1 ? " coordinate" : " coordinates") + ", got " +
                              std::to_string(msg.coordinates.size()));
  if (is_distance) return read_law_of_length(msg, joint);
  for (std::size_t i = 0; i < msg.coordinates.size(); ++i)
    joint->coordinates[i] = law_of("coordinates[" + std::to_string(i) + "].", msg.coordinates[i]);
}

// ---- lengths, axes, couplings and plugins

/// Returns the length in the message; none, which means the present distance, for zero and below.
std::optional<double> length_of(const std::string& field, double length) {
  if (!std::isfinite(length))
    refuse(field, "must be a finite number, got " + std::to_string(length));
  return length > 0.0 ? std::optional<double>(length) : std::nullopt;
}

/// Rejects lengths and axes that the type does not have.
void check_left_out(const Constraint& msg, std::initializer_list<const char*> used) {
  const std::pair<const char*, double> settings[] = {
      {"length", std::max(msg.length, 0.0)},   {"min_length", msg.min_length},
      {"max_length", msg.max_length},          {"axis_a", from_msg(msg.axis_a).norm()},
      {"axis_b", from_msg(msg.axis_b).norm()},
  };
  for (const auto& setting : settings) {
    const std::string field = setting.first;
    const bool is_used = std::find(used.begin(), used.end(), field) != used.end();
    if (!is_used) check_zero("", of_type(msg) + " have none", {setting});
  }
}

/// Reads the lengths of `distance` or its shorthands `rope`, `strut` and `spring`.
engine::DistanceJoint lengths_of(const Constraint& msg, double present_distance) {
  engine::DistanceJoint distance;
  if (msg.type == "distance") {
    check_left_out(msg, {"length", "min_length", "max_length"});
    distance.length = length_of("length", msg.length);
    distance.min_length = msg.min_length;
    if (msg.max_length != 0.0) distance.max_length = msg.max_length;
  } else if (msg.type == "rope") {
    check_left_out(msg, {"max_length"});
    distance.max_length = msg.max_length != 0.0 ? msg.max_length : present_distance;
  } else if (msg.type == "strut") {
    check_left_out(msg, {"min_length"});
    distance.min_length = msg.min_length != 0.0 ? msg.min_length : present_distance;
  } else if (msg.type == "spring") {
    check_left_out(msg, {"length"});
    distance.length = length_of("length", msg.length);
  } else {
    refuse("type", "there is no '" + msg.type + "'; there are distance, rope, strut, spring" +
                       engine::names_of_further_kinds() +
                       "; custom: and custom_force: go before the type of a plugin");
  }
  return distance;
}

Eigen::Vector3d finite_axis(const char* field, const geometry_msgs::Vector3& axis) {
  const Eigen::Vector3d v = from_msg(axis);
  if (!v.allFinite())
    refuse(field, "must be finite numbers, got (" + std::to_string(v.x()) + ", " +
                      std::to_string(v.y()) + ", " + std::to_string(v.z()) + ")");
  return v;
}

/// Reads the axes. A zero axis_a means z of body A; a zero axis_b means that axis B coincides with
/// axis A in the present poses.
void read_axes(const Constraint& msg, engine::Joint* joint) {
  if (!engine::info(joint->kind).has_frames) return check_left_out(msg, {});
  check_left_out(msg, {"axis_a", "axis_b"});
  const Eigen::Vector3d axis_a = finite_axis("axis_a", msg.axis_a);
  const Eigen::Vector3d axis_b = finite_axis("axis_b", msg.axis_b);
  if (!axis_a.isZero(0.0)) joint->frame_a = engine::frame_along(axis_a);
  if (!axis_b.isZero(0.0)) joint->axis_b = axis_b;
}

void read_coupling(const Constraint& msg, engine::Joint* joint) {
  const Coupling& coupling = msg.coupling;
  const std::string why = of_type(msg) + " have none";
  if (!engine::info(joint->kind).couples_joints)
    check_zero("coupling.", why, {{"ratio", coupling.ratio}});
  if (!engine::info(joint->kind).has_pitch)
    check_zero("coupling.", why, {{"pitch", coupling.pitch}});
  if (!engine::info(joint->kind).couples)
    check_zero("coupling.", why, {{"has_value", coupling.has_value ? 1.0 : 0.0}});
  if (!engine::info(joint->kind).couples_lengths)
    check_zero("coupling.", why, {{"one_sided", coupling.one_sided ? 1.0 : 0.0}});
  if (coupling.ratio != 0.0) joint->coupling.ratio = coupling.ratio;
  joint->pitch = coupling.pitch;
  joint->coupling.one_sided = coupling.one_sided;
  if (coupling.has_value)
    joint->coupling.value = coupling.value;
  else
    check_zero("coupling.", "needs has_value", {{"value", coupling.value}});
}

/// Reads a constraint of a plugin: its type stands after a colon.
void read_plugin(const Constraint& msg, engine::Joint* joint) {
  const std::size_t colon = msg.type.find(':');
  if (!engine::info(joint->kind).is_custom) {
    if (colon != std::string::npos)
      refuse("type",
             "only custom: and custom_force: have a type after them, got '" + msg.type + "'");
    if (!msg.parameters.empty())
      refuse("parameters", of_type(msg) + " have none, got '" + msg.parameters[0].name + "'");
    return;
  }
  if (colon != std::string::npos) joint->custom.type = msg.type.substr(colon + 1);
  std::set<std::string> seen;
  for (const Parameter& parameter : msg.parameters) {
    if (!seen.insert(parameter.name).second)
      refuse("parameters", "'" + parameter.name + "' is there twice");
    joint->custom.parameters.push_back({parameter.name, parameter.value});
  }
}

// ---- bodies and kinds

/// Reads a gear or pulley: its fields for bodies name constraints.
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
    if (value != none) refuse(field, of_type(msg) + " have none");
  return joint;
}

/// Returns the joint kind. A `distance` that is free is a kind of its own.
engine::JointKind kind_of(const Constraint& msg) {
  if (msg.free && msg.type != "distance") refuse("free", of_type(msg) + " have none, got true");
  if (msg.free) return engine::JointKind::kFreeDistance;
  return engine::joint_kind_named(msg.type.substr(0, msg.type.find(':')))
      .value_or(engine::Joint{}.kind);
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

double present_distance(const engine::World& world, const engine::Joint& joint) {
  const auto in_world = [&](engine::BodyId body, const Eigen::Vector3d& anchor) -> Eigen::Vector3d {
    const engine::BodyState& state = world.state(body);
    return state.position + state.orientation * anchor;
  };
  return (in_world(joint.body_b, joint.anchor_b) - in_world(joint.body_a, joint.anchor_a)).norm();
}

}  // namespace

engine::Joint from_msg(const AddDistanceConstraintRequest& request, const engine::World& world) {
  engine::DistanceJoint distance;
  distance.length = length_of("length", request.length);
  engine::Joint joint = joint_between(request, world);
  joint.distance = distance;
  return joint;
}

engine::Joint from_msg(const Constraint& msg, const engine::World& world) {
  const engine::JointKind kind = kind_of(msg);
  engine::Joint joint =
      engine::info(kind).couples_joints ? coupling_between(msg, world) : joint_between(msg, world);
  joint.kind = kind;
  const engine::DistanceJoint* distance = engine::if_distance(joint);
  if (distance == nullptr)
    read_axes(msg, &joint);
  else
    joint.distance = lengths_of(msg, present_distance(world, joint));
  read_laws(msg, &joint);
  read_coupling(msg, &joint);
  read_plugin(msg, &joint);
  if (distance != nullptr && msg.type == "spring" && !distance->is_soft())
    refuse("coordinates[0].frequency", "a spring needs one, or a stiffness or damping");
  if (distance != nullptr)
    check_zero("", of_type(msg) + " have none", {{"break_torque", msg.break_torque}});
  if (msg.baumgarte != 0.0) joint.baumgarte = msg.baumgarte;
  joint.break_force = msg.break_force;
  joint.break_torque = msg.break_torque;
  joint.collide_connected = msg.collide_connected;
  return joint;
}

}  // namespace constraint_sim
