#pragma once

#include <ros/node_handle.h>
#include <ros/publisher.h>
#include <sensor_msgs/JointState.h>

#include <map>
#include <mutex>
#include <string>
#include <vector>

#include "ros/robots.h"

namespace constraint_sim {

/// The topic robots/<robot>/joint_states and the parameter robots/<robot>/robot_description of each
/// robot, whose names have the robot's prefix: a robot_state_publisher in that namespace needs no
/// settings. update() and publish() belong to one thread; anybody_listens() is for any thread.
class RobotTopics {
 public:
  RobotTopics(const ros::NodeHandle& private_handle, ros::SubscriberStatusCallback welcome);
  /// Deletes the parameters.
  ~RobotTopics();
  RobotTopics(const RobotTopics&) = delete;
  RobotTopics& operator=(const RobotTopics&) = delete;

  /// Advertises the topics and sets the parameters of new robots. Shuts down topics and deletes
  /// parameters of removed robots.
  void update(const std::vector<RobotDescription>& robots);
  bool anybody_listens() const;
  /// Adds the joints of all robots that are fixed since they move no mass, at rest: programs such
  /// as robot_state_publisher take them for movable.
  void add_fixed_joints(sensor_msgs::JointState* all) const;
  /// Publishes the part of a message on all joints that is about each robot.
  void publish(const sensor_msgs::JointState& all) const;

 private:
  struct Topic {
    ros::Publisher publisher;
    RobotDescription robot;
  };
  using Topics = std::map<std::string, Topic>;  // by the robot's name

  ros::NodeHandle handle_;
  ros::SubscriberStatusCallback welcome_;
  mutable std::mutex mutex_;  // protects topics_, which update() writes and other threads read
  Topics topics_;
};

}  // namespace constraint_sim
