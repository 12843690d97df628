#pragma once

#include <ros/node_handle.h>
#include <ros/subscriber.h>
#include <ros/time.h>

#include <cstdint>
#include <string>
#include <vector>

#include "ros/command_changes.h"
#include "ros/edit_log.h"
#include "ros/parameters.h"
#include "ros/robots.h"
#include "ros/trajectory_actions.h"
#include "sim/stepper.h"

namespace constraint_sim {

/// Subscribers of the command topics: joint_trajectory, and as parameters list them
/// command/<constraint>, cmd_vel/<body> and wrench/<body>; and receiver of the goals of actions.
/// Invalid messages are dropped behind a Guard.
class Commands {
 public:
  Commands(Stepper& stepper, EditLog& edit_log, const Parameters& parameters, const Robots& robots,
           TrajectoryActions& actions, ros::NodeHandle handle);
  /// Ends the actions.
  ~Commands();
  Commands(const Commands&) = delete;
  Commands& operator=(const Commands&) = delete;

  // ---- stepping thread
  void before_step(Driver* driver) { changes_.before_step(driver); }
  /// Returns whether stepped() has anything to do.
  bool has_goals() { return !changes_.goals()->empty(); }
  void stepped(const World& world, const ros::Time& stamp);
  void edited(const World& world);
  void end(const std::string& by);

 private:
  void begin(TrajectoryActions::Id id, const TrajectoryGoal& goal);
  void cancel(TrajectoryActions::Id id);
  void finish_goals();
  template <class Message, class ChangeBy>
  void listen(ros::NodeHandle& handle, const std::string& topic, std::uint32_t queue,
              ChangeBy change_by);

  Stepper& stepper_;
  EditLog& edit_log_;
  TrajectoryActions& actions_;
  CommandChanges changes_;
  double next_feedback_ = 0.0;  // steady time [s]
  std::vector<ros::Subscriber> subscribers_;
};

}  // namespace constraint_sim
