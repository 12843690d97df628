#include "ros/constraint_state.h"

#include <cmath>
#include <limits>
#include <optional>
#include <stdexcept>

#include "ros/conversions.h"

namespace constraint_sim {
namespace {

using engine::Joint;
using engine::JointState;

constexpr double kNone = std::numeric_limits<double>::quiet_NaN();

/// Whether the joint has an error: springs and custom forces hold nothing.
bool has_error(const Joint& joint) {
  const engine::DistanceJoint* distance = engine::if_distance(joint);
  return distance != nullptr ? !distance->is_soft() : joint.kind != engine::JointKind::kCustomForce;
}

void write_errors(const Joint& joint, const JointState& state, ConstraintState* msg) {
  msg->error = msg->closing_error = msg->error_rate = kNone;
  if (!has_error(joint) || !std::isfinite(state.error)) return;
  (state.closing ? msg->closing_error : msg->error) = state.error;
  (state.closing ? msg->error : msg->closing_error) = 0.0;
  msg->error_rate = state.error_rate;
}

/// Whether a motor requests a rate, by velocity or by position.
bool has_rigid_motor(const Joint& joint) {
  if (engine::if_distance(joint) != nullptr) return true;
  const std::optional<engine::Motor>& motor = joint.coordinates[0].motor;
  return engine::info(joint.kind).coordinates > 0 && motor && motor->is_rigid();
}

void write_motion(const engine::World& world, engine::JointId id, ConstraintState* msg) {
  const Joint& joint = world.joint(id);
  const JointState& state = world.joint_state(id);
  const bool is_distance = engine::if_distance(joint) != nullptr;
  msg->position = msg->reached_rate = msg->bias = kNone;
  if (has_rigid_motor(joint)) msg->bias = state.bias;
  if (!is_distance && engine::info(joint.kind).coordinates == 0) return;
  const engine::World::Anchors anchors = world.anchors(id);
  msg->position = is_distance ? (anchors.p_b - anchors.p_a).norm() : state.coordinates[0].position;
  msg->reached_rate = state.reached_rate;
}

/// Writes the wrench on body B along the axes of the world.
void write_wrench(const engine::World& world, engine::JointId id, ConstraintState* msg) {
  const Joint& joint = world.joint(id);
  msg->wrench.force.x = msg->wrench.force.y = msg->wrench.force.z = kNone;
  msg->wrench.torque = msg->wrench.force;
  msg->wrench_point.x = msg->wrench_point.y = msg->wrench_point.z = kNone;
  if (engine::info(joint.kind).couples_joints) return;
  msg->wrench_point = to_point(world.anchors(id).p_b);
  const Eigen::Quaterniond& of_body = world.state(joint.body_b).orientation;
  const Eigen::Quaterniond to_world =
      engine::info(joint.kind).has_frames ? of_body * *joint.frame_b : of_body;
  try {
    const engine::World::JointWrench wrench = world.joint_wrench(id);
    msg->wrench.force = to_vector(to_world * wrench.force);
    msg->wrench.torque = to_vector(to_world * wrench.torque);
  } catch (const std::invalid_argument&) {
    // A function of another package failed; the next step reports the failure.
  }
}

/// Clamps infinities to the largest finite double, and keeps NaN.
void clamp(double* figure) {
  if (!std::isnan(*figure)) *figure = finite(*figure);
}

}  // namespace

ConstraintState to_msg(const engine::World& world, engine::JointId id) {
  const Joint& joint = world.joint(id);
  const JointState& state = world.joint_state(id);
  ConstraintState msg;
  msg.name = joint.name;
  msg.type = engine::name(joint.kind);
  msg.error = msg.closing_error = msg.error_rate = kNone;
  msg.position = msg.reached_rate = msg.bias = kNone;
  if (joint.enabled && !state.broken) {
    write_errors(joint, state, &msg);
    write_motion(world, id, &msg);
  }
  msg.closing = state.closing;
  msg.broken = state.broken;
  msg.saturated = state.saturated;
  msg.force = state.force;
  write_wrench(world, id, &msg);
  for (double* figure : {&msg.error, &msg.closing_error, &msg.error_rate, &msg.position,
                         &msg.reached_rate, &msg.bias, &msg.force})
    clamp(figure);
  return msg;
}

}  // namespace constraint_sim
