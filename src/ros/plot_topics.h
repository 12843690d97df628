#pragma once

#include <ros/node_handle.h>
#include <ros/publisher.h>
#include <ros/time.h>

#include <map>
#include <mutex>
#include <string>
#include <vector>

#include "constraint_sim/engine/world.h"
#include "ros/robots.h"

namespace constraint_sim {

/// The topic robots/<robot>/plot of each robot, for programs that draw curves and take their names
/// from the type of a message, as PlotJuggler does. Each robot has a type of its own that is made
/// when the robot is added: a header, and a constraint_sim/JointReading for each coordinate under
/// the joint's name. update() and publish() belong to one thread; anybody_listens() is for any
/// thread.
class PlotTopics {
 public:
  PlotTopics(const ros::NodeHandle& private_handle, ros::SubscriberStatusCallback welcome);

  /// Advertises topics of new robots, and new topics for robots whose joints have changed. Ends the
  /// topics of removed robots.
  void update(const std::vector<RobotDescription>& robots, const engine::World& world);
  bool anybody_listens() const;
  void publish(const engine::World& world, const ros::Time& stamp, const std::string& frame) const;

 private:
  struct Topic {
    ros::Publisher publisher;
    std::string type, definition, md5;
    std::vector<engine::JointId> joints;
  };
  using Topics = std::map<std::string, Topic>;  // by the robot's name

  Topic topic_of(const RobotDescription& robot, const engine::World& world) const;

  ros::NodeHandle handle_;
  ros::SubscriberStatusCallback welcome_;
  mutable std::mutex mutex_;  // protects topics_, which update() writes and other threads read
  Topics topics_;
};

}  // namespace constraint_sim
