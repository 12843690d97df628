#pragma once

#include <geometry_msgs/Twist.h>
#include <geometry_msgs/WrenchStamped.h>
#include <ros/node_handle.h>
#include <ros/subscriber.h>
#include <std_msgs/Float64.h>
#include <trajectory_msgs/JointTrajectory.h>

#include <cstdint>
#include <functional>
#include <map>
#include <string>
#include <vector>

#include "ros/edit_log.h"
#include "ros/guarded.h"
#include "ros/parameters.h"
#include "ros/robots.h"
#include "sim/stepper.h"
#include "sim/trajectories.h"

namespace constraint_sim {

/// The topics that drive: joint_trajectory, and by parameter lists command/<constraint>,
/// cmd_vel/<body> and wrench/<body>. A message that cannot be is dropped behind a Guard.
class Commands {
 public:
  Commands(Stepper& stepper, EditLog& edit_log, const Parameters& parameters, const Robots& robots,
           ros::NodeHandle handle);

  /// Before each tick, on the stepping thread.
  void before_step(Driver* driver);
  /// Ends all that drives, in the name of `by`, and tells what did; on the stepping thread.
  void end(const std::string& by);

 private:
  /// What a body is driven by until the next message, in its own axes or the world's.
  struct Drive {
    Eigen::Vector3d linear = Eigen::Vector3d::Zero(), angular = Eigen::Vector3d::Zero();
    bool in_body_axes = true;
  };
  using Drives = std::map<std::string, Drive>;  // by names of bodies

  using Change = std::function<void(Driver*)>;

  template <class Message, class ChangeBy>
  void listen(ros::NodeHandle& handle, const std::string& topic, std::uint32_t queue,
              ChangeBy change_by);
  void drive(Driver* driver, Guard* guard, Drives* drives,
             void (*act)(engine::BodyId, const Eigen::Vector3d&, const Eigen::Vector3d&, Driver*));
  Change change_by_trajectory(const trajectory_msgs::JointTrajectory& message);
  Change change_by_command(const std::string& constraint, double value);
  Change change_by_twist(const std::string& body, const geometry_msgs::Twist& message);
  Change change_by_wrench(const std::string& body, const geometry_msgs::WrenchStamped& message);
  void command(Driver* driver, const std::string& constraint, double value);

  Stepper& stepper_;
  EditLog& edit_log_;
  Parameters parameters_;
  const Robots& robots_;
  // of the stepping thread
  Trajectories trajectories_;
  Drives twists_, wrenches_;
  Guard joint_trajectory_, cmd_vel_, wrench_;
  std::vector<ros::Subscriber> subscribers_;
};

}  // namespace constraint_sim
