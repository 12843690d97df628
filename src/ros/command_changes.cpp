#include "ros/command_changes.h"

#include <ros/console.h>

#include <algorithm>
#include <iterator>
#include <stdexcept>
#include <utility>

#include "engine/model/validate.h"
#include "ros/conversions.h"
#include "sim/words.h"

namespace constraint_sim {
namespace {

using Eigen::Vector3d;

// Returns the time from now until `stamp` [s]. Throws std::invalid_argument where it exceeds the
// range of ros::Duration.
double seconds_until(const ros::Time& stamp) {
  try {
    return (stamp - ros::Time::now()).toSec();
  } catch (const std::runtime_error&) {
    throw std::invalid_argument("header.stamp: must be within 2^31 s of now, got " +
                                std::to_string(stamp.sec) + " s");
  }
}

Vector3d finite_vector(const char* field, const geometry_msgs::Vector3& message) {
  const Vector3d vector = from_msg(message);
  engine::check_finite(field, vector);
  return vector;
}

void set_twist(engine::BodyId id, const Vector3d& linear, const Vector3d& angular, Driver* driver) {
  const World& world = driver->world();
  if (world.body(id).type != engine::BodyType::kKinematic)
    throw std::invalid_argument("body '" + world.body(id).name + "' is not kinematic");
  engine::BodyState state = world.state(id);
  if (state.linear_velocity == linear && state.angular_velocity == angular) return;
  state.linear_velocity = linear;
  state.angular_velocity = angular;
  driver->set_state(id, state);
}

// Applies a force [N] and torque [N m], in the world's frame, for one tick.
void push(engine::BodyId id, const Vector3d& force, const Vector3d& torque, Driver* driver) {
  const World& world = driver->world();
  if (force.isZero(0.0) && torque.isZero(0.0)) return;
  engine::Wrench wrench;
  wrench.body = id;
  wrench.force = force;
  wrench.torque = torque;
  wrench.start = world.time();
  wrench.end = world.time() + world.options().time_step;
  driver->add_wrench(wrench);
}

// Clamps `value` to ±most; most = 0 means no bound.
double bounded(double value, double most) {
  return most > 0.0 ? std::clamp(value, -most, most) : value;
}

}  // namespace

JointTrajectory trajectory_from_msg(const trajectory_msgs::JointTrajectory& message) {
  JointTrajectory trajectory;
  trajectory.joints = message.joint_names;
  for (const trajectory_msgs::JointTrajectoryPoint& point : message.points)
    trajectory.points.push_back(
        {point.time_from_start.toSec(), point.positions, point.velocities, point.accelerations});
  if (!message.header.stamp.isZero()) trajectory.delay = seconds_until(message.header.stamp);
  return trajectory;
}

CommandChanges::CommandChanges(const Parameters& parameters, const Robots& robots)
    : parameters_(parameters),
      robots_(robots),
      joint_trajectory_("joint_trajectory"),
      cmd_vel_("cmd_vel"),
      wrench_("wrench") {}

// ---- stepping thread

void CommandChanges::before_step(Driver* driver) {
  joint_trajectory_([&] {
    for (const std::string& failure : trajectories_.before_step(driver))
      joint_trajectory_.warn(failure);
  });
  drive(driver, &cmd_vel_, &twists_, set_twist);
  drive(driver, &wrench_, &wrenches_, push);
}

void CommandChanges::end(const std::string& by) {
  const auto tell_of = [&](const char* topic, const std::vector<std::string>& names) {
    std::string list;
    for (const std::string& name : names) list += (list.empty() ? "" : ", ") + name;
    if (!list.empty()) ROS_INFO("%s: ended by %s: %s", topic, by.c_str(), list.c_str());
  };
  const auto names_of = [](Drives* drives) {
    std::vector<std::string> names;
    for (const auto& [name, drive] : std::exchange(*drives, {})) names.push_back(name);
    return names;
  };
  tell_of("joint_trajectory", trajectories_.end());
  goals_.end(by);
  tell_of("cmd_vel", names_of(&twists_));
  tell_of("wrench", names_of(&wrenches_));
}

// Applies every drive, and drops those whose body is gone or has changed its type, as after
// load_scene.
void CommandChanges::drive(Driver* driver, Guard* guard, Drives* drives,
                           void (*act)(engine::BodyId, const Eigen::Vector3d&,
                                       const Eigen::Vector3d&, Driver*)) {
  const World& world = driver->world();
  for (auto next = drives->begin(); next != drives->end();) {
    const auto& [name, drive] = *next;
    const bool goes_on = (*guard)([&, &name = name, &drive = drive] {
      const engine::BodyId id = find_own_body(world, "body", name);
      const Eigen::Quaterniond R =
          drive.in_body_axes ? world.state(id).orientation : Eigen::Quaterniond::Identity();
      act(id, R * drive.linear, R * drive.angular, driver);
    });
    next = goes_on ? std::next(next) : drives->erase(next);
  }
}

// Sets the position, the force or the rate of the motor, by the kind of motor that the constraint
// has.
void CommandChanges::command(Driver* driver, const std::string& constraint, double value) {
  const World& world = driver->world();
  engine::check_finite("data", value);
  const engine::JointId id = find_joint(world, "command", constraint);
  const engine::Joint& joint = world.joint(id);
  const bool was_driven = trajectories_.drives(id);
  const bool was_to_position = trajectories_.drop(id);
  goals_.replace({constraint}, "a command");
  const JointBounds bounds = robots_.bounds(world, id);
  engine::Motor motor = joint.motor;
  const double asked = value;
  if (engine::info(joint.kind).coordinates == 0) {
    motor.bias = bounded(value, bounds.velocity);
    return driver->set_motor(id, motor);
  }
  if (!joint.coordinates[0].motor)
    throw std::invalid_argument("'" + constraint + "' has no motor to command");
  motor = *joint.coordinates[0].motor;
  const engine::CoordinateLaw& law = joint.coordinates[0];
  if (was_driven) motor.amplitude = motor.frequency = motor.phase = 0.0;
  if (motor.position || was_to_position) {
    motor.position = value = std::clamp(value, law.lower, law.upper);
    motor.bias = 0.0;
  } else if (motor.force)
    motor.force = value = bounded(value, bounds.effort);
  else
    motor.bias = value = bounded(value, bounds.velocity);
  driver->set_motor(id, motor);
  if (value != asked)
    throw std::invalid_argument("'" + constraint + "' is bounded to " + std::to_string(value) +
                                ", asked for " + std::to_string(asked));
}

// ---- subscriber threads: each function returns a change for the stepping thread

CommandChanges::Change CommandChanges::by_trajectory(
    const trajectory_msgs::JointTrajectory& message) {
  return [this, trajectory = trajectory_from_msg(message)](Driver* driver) {
    trajectories_.begin(driver->world(), trajectory);
    goals_.replace(trajectory.joints, "a message of joint_trajectory");
  };
}

CommandChanges::Change CommandChanges::by_goal(TrajectoryGoals::Id id, const TrajectoryGoal& goal) {
  return [this, id, goal](Driver* driver) { goals_.begin(driver->world(), id, goal); };
}

CommandChanges::Change CommandChanges::by_cancel(TrajectoryGoals::Id id) {
  return [this, id](Driver* driver) { goals_.cancel(driver->world(), id); };
}

CommandChanges::Change CommandChanges::by_command(const std::string& constraint, double value) {
  return [this, constraint, value](Driver* driver) { command(driver, constraint, value); };
}

CommandChanges::Change CommandChanges::by_twist(const std::string& body,
                                                const geometry_msgs::Twist& message) {
  const Drive drive{finite_vector("linear", message.linear),
                    finite_vector("angular", message.angular), true};
  return [this, body, drive](Driver*) { twists_[body] = drive; };
}

CommandChanges::Change CommandChanges::by_wrench(const std::string& body,
                                                 const geometry_msgs::WrenchStamped& message) {
  Drive drive{finite_vector("force", message.wrench.force),
              finite_vector("torque", message.wrench.torque), false};
  const std::string& frame = message.header.frame_id;
  drive.in_body_axes = frame == parameters_.frame_prefix + body;
  const bool is_known = drive.in_body_axes || frame.empty() || frame == parameters_.world_frame;
  if (!is_known)
    throw std::invalid_argument("frame_id: must be empty, the world's or the body's own, got '" +
                                shortened(frame) + "'");
  return [this, body, drive](Driver*) { wrenches_[body] = drive; };
}

}  // namespace constraint_sim
