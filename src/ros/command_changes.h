#pragma once

#include <geometry_msgs/Twist.h>
#include <geometry_msgs/WrenchStamped.h>
#include <trajectory_msgs/JointTrajectory.h>

#include <functional>
#include <map>
#include <string>

#include "ros/guarded.h"
#include "ros/parameters.h"
#include "ros/robots.h"
#include "sim/drive_changes.h"
#include "sim/trajectories.h"
#include "sim/trajectory_goals.h"

namespace constraint_sim {

/// Throws std::invalid_argument for a stamp that is too far from now.
JointTrajectory trajectory_from_msg(const trajectory_msgs::JointTrajectory& message);

/// Changes of a world by the messages that class Commands receives: trajectories and goals of
/// actions, twists, wrenches and commands of motors.
class CommandChanges {
 public:
  using Change = std::function<void(Driver*)>;

  CommandChanges(const Parameters& parameters, const Robots& robots);

  // ---- any thread. Each function returns the change for the stepping thread to make. Both throw
  // std::invalid_argument for invalid messages.
  Change by_trajectory(const trajectory_msgs::JointTrajectory& message);
  Change by_goal(TrajectoryGoals::Id id, const TrajectoryGoal& goal);
  Change by_cancel(TrajectoryGoals::Id id);
  Change by_command(const std::string& constraint, double value);
  Change by_twist(const std::string& body, const geometry_msgs::Twist& message);
  Change by_wrench(const std::string& body, const geometry_msgs::WrenchStamped& message);

  // ---- stepping thread
  /// Applies all drives; call before each tick.
  void before_step(Driver* driver);
  /// Ends all drives and logs their names; `by` names the cause.
  void end(const std::string& by);
  TrajectoryGoals* goals() { return &goals_; }

 private:
  /// A twist or wrench that acts on a body until the next message, in the body's or the world's
  /// axes.
  struct Drive {
    Eigen::Vector3d linear = Eigen::Vector3d::Zero(), angular = Eigen::Vector3d::Zero();
    bool in_body_axes = true;
  };
  using Drives = std::map<std::string, Drive>;  // by body name

  void drive(Driver* driver, Guard* guard, Drives* drives,
             void (*act)(engine::BodyId, const Eigen::Vector3d&, const Eigen::Vector3d&, Driver*));
  void command(Driver* driver, const std::string& constraint, double value);

  Parameters parameters_;
  const Robots& robots_;
  // accessed on the stepping thread only
  Trajectories trajectories_;
  TrajectoryGoals goals_{&trajectories_};
  Drives twists_, wrenches_;
  Guard joint_trajectory_, cmd_vel_, wrench_;
};

}  // namespace constraint_sim
