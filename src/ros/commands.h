#pragma once

#include <geometry_msgs/Twist.h>
#include <geometry_msgs/WrenchStamped.h>
#include <ros/node_handle.h>
#include <ros/subscriber.h>
#include <std_msgs/Float64.h>
#include <trajectory_msgs/JointTrajectory.h>

#include <atomic>
#include <map>
#include <string>
#include <vector>

#include "ros/parameters.h"
#include "ros/robots.h"
#include "sim/stepper.h"
#include "sim/trajectories.h"

namespace constraint_sim {

/// The topics that drive: joint_trajectory, and by parameter lists command/<constraint>,
/// cmd_vel/<body> and wrench/<body>. What cannot be is told, at most once a second.
class Commands {
 public:
  Commands(Stepper& stepper, const Parameters& parameters, const Robots& robots,
           ros::NodeHandle handle);

  /// Before each tick, on the stepping thread.
  void before_step(World* world);
  /// Ends all that drives, in the name of `by`, and tells what did; on the stepping thread.
  void end(const std::string& by);

 private:
  /// What a body is driven by until the next message, in its own axes or the world's.
  struct Drive {
    Eigen::Vector3d linear = Eigen::Vector3d::Zero(), angular = Eigen::Vector3d::Zero();
    bool in_body_axes = true;
  };
  using Drives = std::map<std::string, Drive>;  // by names of bodies

  void drive(World* world, const char* topic, Drives* drives,
             void (*act)(engine::BodyId, const Eigen::Vector3d&, const Eigen::Vector3d&, World*));
  void on_trajectory(const trajectory_msgs::JointTrajectory& message);
  void on_command(const std::string& constraint, double value);
  void on_twist(const std::string& body, const geometry_msgs::Twist& message);
  void on_wrench(const std::string& body, const geometry_msgs::WrenchStamped& message);
  void command(World& world, const std::string& constraint, double value);
  void post(const std::string& topic, std::function<void(World&)> change);
  void tell(const std::string& topic, const std::string& why);

  Stepper& stepper_;
  Parameters parameters_;
  const Robots& robots_;
  std::atomic<double> told_{-1e9};  // [s]
  // of the stepping thread
  Trajectories trajectories_;
  Drives twists_, wrenches_;
  std::vector<ros::Subscriber> subscribers_;
};

}  // namespace constraint_sim
