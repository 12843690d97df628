#pragma once

#include <ros/node_handle.h>
#include <ros/subscriber.h>

#include <cstdint>
#include <string>
#include <vector>

#include "ros/command_changes.h"
#include "ros/edit_log.h"
#include "ros/parameters.h"
#include "ros/robots.h"
#include "sim/stepper.h"

namespace constraint_sim {

/// Subscribers of the command topics: joint_trajectory, and as parameters list them
/// command/<constraint>, cmd_vel/<body> and wrench/<body>. Invalid messages are dropped behind a
/// Guard.
class Commands {
 public:
  Commands(Stepper& stepper, EditLog& edit_log, const Parameters& parameters, const Robots& robots,
           ros::NodeHandle handle);

  // Forwarded to CommandChanges.
  void before_step(Driver* driver) { changes_.before_step(driver); }
  void end(const std::string& by) { changes_.end(by); }

 private:
  template <class Message, class ChangeBy>
  void listen(ros::NodeHandle& handle, const std::string& topic, std::uint32_t queue,
              ChangeBy change_by);

  Stepper& stepper_;
  EditLog& edit_log_;
  CommandChanges changes_;
  std::vector<ros::Subscriber> subscribers_;
};

}  // namespace constraint_sim
