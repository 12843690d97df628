#include "ros/commands.h"

#include <ros/console.h>

#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <utility>

#include "ros/conversions.h"
#include "ros/topic_names.h"

namespace constraint_sim {
namespace {

using Eigen::Vector3d;

JointTrajectory from_msg(const trajectory_msgs::JointTrajectory& message) {
  JointTrajectory trajectory;
  trajectory.joints = message.joint_names;
  for (const trajectory_msgs::JointTrajectoryPoint& point : message.points)
    trajectory.points.push_back(
        {point.time_from_start.toSec(), point.positions, point.velocities, point.accelerations});
  if (!message.header.stamp.isZero())
    trajectory.delay = (message.header.stamp - ros::Time::now()).toSec();
  return trajectory;
}

void check_finite(double value) {
  if (!std::isfinite(value)) throw std::invalid_argument("data: must be a finite number");
}

void set_twist(engine::BodyId id, const Vector3d& linear, const Vector3d& angular, World* world) {
  if (world->body(id).type != engine::BodyType::kKinematic)
    throw std::invalid_argument("body '" + world->body(id).name + "' is not kinematic");
  engine::BodyState state = world->state(id);
  if (state.linear_velocity == linear && state.angular_velocity == angular) return;
  state.linear_velocity = linear;
  state.angular_velocity = angular;
  world->set_state(id, state);
}

// for one tick
void push(engine::BodyId id, const Vector3d& force, const Vector3d& torque, World* world) {
  if (force.isZero(0.0) && torque.isZero(0.0)) return;
  engine::Wrench wrench;
  wrench.body = id;
  wrench.force = force;
  wrench.torque = torque;
  wrench.start = world->time();
  wrench.end = world->time() + world->options().time_step;
  world->add_wrench(wrench);
}

// at most `most` in size, 0: as it is
double bounded(double value, double most) {
  return most > 0.0 ? std::clamp(value, -most, most) : value;
}

}  // namespace

Commands::Commands(Stepper& stepper, const Parameters& parameters, const Robots& robots,
                   ros::NodeHandle handle)
    : stepper_(stepper), parameters_(parameters), robots_(robots) {
  subscribers_.push_back(handle.subscribe("joint_trajectory", 10, &Commands::on_trajectory, this));
  for (const std::string& name : names_in(parameters.command))
    subscribers_.push_back(handle.subscribe<std_msgs::Float64>(
        topic_of("command", name), 100, [this, name](const std_msgs::Float64ConstPtr& message) {
          on_command(name, message->data);
        }));
  for (const std::string& name : names_in(parameters.cmd_vel))
    subscribers_.push_back(handle.subscribe<geometry_msgs::Twist>(
        topic_of("cmd_vel", name), 100,
        [this, name](const geometry_msgs::TwistConstPtr& message) { on_twist(name, *message); }));
  for (const std::string& name : names_in(parameters.wrench))
    subscribers_.push_back(handle.subscribe<geometry_msgs::WrenchStamped>(
        topic_of("wrench", name), 100,
        [this, name](const geometry_msgs::WrenchStampedConstPtr& message) {
          on_wrench(name, *message);
        }));
}

// ---- on the stepping thread

void Commands::before_step(World* world) {
  trajectories_.before_step(world);
  drive(world, "cmd_vel", &twists_, set_twist);
  drive(world, "wrench", &wrenches_, push);
}

void Commands::end(const std::string& by) {
  const auto tell_of = [&](const char* topic, const std::vector<std::string>& names) {
    std::string list;
    for (const std::string& name : names) list += (list.empty() ? "" : ", ") + name;
    if (!list.empty()) ROS_WARN("%s: ended by %s: %s", topic, by.c_str(), list.c_str());
  };
  const auto names_of = [](Drives* drives) {
    std::vector<std::string> names;
    for (const auto& [name, drive] : std::exchange(*drives, {})) names.push_back(name);
    return names;
  };
  tell_of("joint_trajectory", trajectories_.end());
  tell_of("cmd_vel", names_of(&twists_));
  tell_of("wrench", names_of(&wrenches_));
}

// Of bodies that are no longer what they were for, as after load_scene, it ends.
void Commands::drive(World* world, const char* topic, Drives* drives,
                     void (*act)(engine::BodyId, const Eigen::Vector3d&, const Eigen::Vector3d&,
                                 World*)) {
  for (auto next = drives->begin(); next != drives->end();) {
    const auto& [name, drive] = *next;
    try {
      const engine::BodyId id = find_own_body(*world, "body", name);
      const Eigen::Quaterniond R =
          drive.in_body_axes ? world->state(id).orientation : Eigen::Quaterniond::Identity();
      act(id, R * drive.linear, R * drive.angular, world);
      ++next;
    } catch (const std::invalid_argument& error) {
      tell(topic, error.what());
      next = drives->erase(next);
    }
  }
}

// By what motor there is: a position, a force, or a rate.
void Commands::command(World& world, const std::string& constraint, double value) {
  check_finite(value);
  const engine::JointId id = find_joint(world, "command", constraint);
  const engine::Joint& joint = world.joint(id);
  trajectories_.drop(id);
  const JointBounds bounds = robots_.bounds(world, id);
  if (engine::coordinates(joint.kind) == 0) {
    engine::Motor motor = joint.motor;
    motor.bias = bounded(value, bounds.velocity);
    world.set_motor(id, motor);
    return;
  }
  if (!joint.coordinates[0].motor)
    throw std::invalid_argument("'" + constraint + "' has no motor to command");
  engine::CoordinateMotor motor = *joint.coordinates[0].motor;
  const engine::CoordinateLaw& law = joint.coordinates[0];
  const double asked = value;
  if (motor.position)
    motor.position = value = std::clamp(value, law.lower, law.upper);
  else if (motor.force)
    motor.force = value = bounded(value, bounds.effort);
  else
    motor.bias = value = bounded(value, bounds.velocity);
  world.set_motor(id, 0, motor);
  if (value != asked)
    throw std::invalid_argument("'" + constraint + "' is bounded to " + std::to_string(value) +
                                ", asked for " + std::to_string(asked));
}

// ---- on the threads of edits

void Commands::on_trajectory(const trajectory_msgs::JointTrajectory& message) {
  post("joint_trajectory", [this, trajectory = from_msg(message)](World& world) {
    trajectories_.begin(world, trajectory);
  });
}

void Commands::on_command(const std::string& constraint, double value) {
  post("command/" + constraint,
       [this, constraint, value](World& world) { command(world, constraint, value); });
}

void Commands::on_twist(const std::string& body, const geometry_msgs::Twist& message) {
  const Drive drive{constraint_sim::from_msg(message.linear),
                    constraint_sim::from_msg(message.angular), true};
  post("cmd_vel/" + body, [this, body, drive](World&) { twists_[body] = drive; });
}

void Commands::on_wrench(const std::string& body, const geometry_msgs::WrenchStamped& message) {
  Drive drive{constraint_sim::from_msg(message.wrench.force),
              constraint_sim::from_msg(message.wrench.torque), false};
  const std::string& frame = message.header.frame_id;
  drive.in_body_axes = frame == parameters_.frame_prefix + body;
  const bool is_known = drive.in_body_axes || frame.empty() || frame == parameters_.world_frame;
  post("wrench/" + body, [this, body, drive, frame, is_known](World&) {
    if (!is_known)
      throw std::invalid_argument("frame_id: must be empty, the world's or the body's own, got '" +
                                  frame + "'");
    wrenches_[body] = drive;
  });
}

void Commands::post(const std::string& topic, std::function<void(World&)> change) {
  try {
    stepper_.post([this, topic, change = std::move(change)](World& world) {
      try {
        change(world);
      } catch (const std::invalid_argument& error) {
        tell(topic, error.what());
      }
    });
  } catch (const NotNow& error) {
    tell(topic, error.what());
  } catch (const Cancelled&) {
    // the node is going down
  }
}

// at most once a second of the wall: simulated time may stand
void Commands::tell(const std::string& topic, const std::string& why) {
  const double now = ros::SteadyTime::now().toSec();
  if (now < told_ + 1.0) return;
  told_ = now;
  ROS_WARN("%s: %s", topic.c_str(), why.c_str());
}

}  // namespace constraint_sim
