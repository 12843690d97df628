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

/// The topics force_torque/<constraint>: what a constraint does to its body B, while somebody
/// listens. update() and publish() are for one thread, anybody_listens() is for any.
class WrenchTopics {
 public:
  /// So many constraints, the first ones, have a topic: each is a call to the master.
  static constexpr std::size_t kMost = 100;

  WrenchTopics(const Parameters& parameters, const ros::NodeHandle& private_handle,
               ros::SubscriberStatusCallback welcome);

  /// Advertises topics of constraints that have none yet, and ends those of constraints that are
  /// gone.
  void update(const engine::World& world);
  bool anybody_listens() const;
  /// Sends what is listened to; returns the frames that the wrenches are in.
  std::vector<geometry_msgs::TransformStamped> publish(const engine::World& world,
                                                       const ros::Time& stamp) const;

 private:
  using Topics = std::map<std::string, ros::Publisher>;  // by constraint

  ros::Publisher advertise(const std::string& constraint, bool is_free);

  Parameters parameters_;
  ros::NodeHandle private_handle_;
  ros::SubscriberStatusCallback welcome_;
  std::set<std::string> without_;  // constraints that were told to have no topic
  mutable std::mutex mutex_;       // writes of update(), reads of other threads
  Topics topics_;
};

}  // namespace constraint_sim
