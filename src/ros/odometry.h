#pragma once

#include <ros/node_handle.h>
#include <ros/publisher.h>

#include <map>
#include <string>

#include "ros/parameters.h"
#include "ros/robots.h"

namespace constraint_sim {

/// The topics odometry/<body> of the bodies and links in the parameter `odometry`: pose in the
/// world's frame; twist at the origin and in the axes of the body or link.
class Odometry {
 public:
  Odometry(const Parameters& parameters, const Robots& robots, ros::NodeHandle& private_handle,
           const ros::SubscriberStatusCallback& welcome);

  bool anybody_listens() const;
  void publish(const engine::World& world, const ros::Time& stamp) const;

 private:
  Parameters parameters_;
  const Robots& robots_;
  std::map<std::string, ros::Publisher> topics_;  // by name of body or link
};

}  // namespace constraint_sim
