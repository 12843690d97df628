#pragma once

#include <ros/time.h>
#include <visualization_msgs/MarkerArray.h>

#include <cstdint>
#include <set>
#include <string>

#include "constraint_sim/engine/world.h"

namespace constraint_sim {

/// What rviz draws: `bodies` and `constraints` with the ids of the world, and all `contacts` as one
/// marker. Bodies are blue, kinematic ones orange, static ones grey; constraints are lines from
/// green (error up to 1e-6 m) over yellow to red (from 1e-2 m); contacts are magenta normals.
class Markers {
 public:
  explicit Markers(std::string frame) : frame_(std::move(frame)) {}

  /// The message that brings a listener from the last one to this world: what moves, what is new,
  /// what is gone, and everything once a second and for a newcomer.
  visualization_msgs::MarkerArray update(const engine::World& world, const ros::Time& stamp,
                                         bool for_newcomer);
  /// Nobody has seen the last messages: the next one has everything again.
  void forget() { started_ = false; }

 private:
  visualization_msgs::Marker make(const char* ns, std::int32_t id, std::int32_t type) const;
  visualization_msgs::Marker body(const engine::World& world, engine::BodyId id) const;
  visualization_msgs::Marker constraint(const engine::World& world, engine::JointId id) const;
  visualization_msgs::Marker contacts(const engine::World& world) const;
  void delete_missing(const char* ns, const std::set<std::int32_t>& present,
                      std::set<std::int32_t>& shown, visualization_msgs::MarkerArray& array) const;

  std::string frame_;
  ros::Time stamp_;
  bool started_ = false;
  ros::Time last_full_;
  std::set<std::int32_t> bodies_shown_;
  std::set<std::int32_t> constraints_shown_;
  std::set<std::int32_t> contacts_shown_;
};

}  // namespace constraint_sim
