#pragma once

#include <geometry_msgs/TransformStamped.h>
#include <ros/node_handle.h>
#include <ros/publisher.h>

#include <map>
#include <mutex>
#include <set>
#include <string>
#include <vector>

#include "constraint_sim/engine/world.h"
#include "ros/parameters.h"

namespace constraint_sim {

/// The topics force_torque/<constraint>: force and torque of a constraint on its body B, sent while
/// there are subscribers. update() and publish() belong to one thread; anybody_listens() is for any
/// thread.
class WrenchTopics {
 public:
  /// Number of constraints with a topic, the first ones: each topic costs a call to the master.
  static constexpr std::size_t kMost = 100;

  WrenchTopics(const Parameters& parameters, const ros::NodeHandle& private_handle,
               ros::SubscriberStatusCallback welcome);

  /// Advertises topics of new constraints, and ends those of removed ones.
  void update(const engine::World& world);
  bool anybody_listens() const;
  /// Publishes topics with subscribers; returns the frames of the wrenches.
  std::vector<geometry_msgs::TransformStamped> publish(const engine::World& world,
                                                       const ros::Time& stamp) const;

 private:
  using Topics = std::map<std::string, ros::Publisher>;  // by constraint

  ros::Publisher advertise(const std::string& constraint, bool is_free);

  Parameters parameters_;
  ros::NodeHandle private_handle_;
  ros::SubscriberStatusCallback welcome_;
  std::set<std::string> without_;  // constraints already logged as having no topic
  mutable std::mutex mutex_;       // protects topics_, which update() writes and other threads read
  Topics topics_;
};

}  // namespace constraint_sim
