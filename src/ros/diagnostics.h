#pragma once

#include <diagnostic_msgs/DiagnosticStatus.h>
#include <ros/node_handle.h>
#include <ros/publisher.h>

#include <string>

#include "ros/frame_follower.h"
#include "ros/parameters.h"
#include "sim/statistics.h"
#include "sim/stepper.h"

namespace constraint_sim {

/// Publishes statuses on /diagnostics once a second: whether the simulator keeps up with its clock,
/// whether constraints hold, whether the physics can go on, and, where bodies follow frames,
/// whether transforms arrive. Runs on the stepping thread, and does nothing without subscribers.
class Diagnostics {
 public:
  Diagnostics(const Parameters& parameters, ros::NodeHandle& handle, const std::string& node);

  void stepped(const World& world, double seconds);
  /// Publishes when due; returns the time until the next call [s].
  double passed(const World& world, const Stepper& stepper, const FrameFollower& follower);

 private:
  using Status = diagnostic_msgs::DiagnosticStatus;

  Status begin(const char* what) const;
  Status clock(const Stepper& stepper, double passed) const;
  Status constraints(const World& world) const;
  Status physics(const World& world, const Stepper& stepper) const;
  Status frames(const FrameFollower& follower) const;
  void start_interval(const Stepper& stepper, double now);

  Parameters parameters_;
  std::string node_;
  ros::Publisher topic_;
  bool listening_ = false;
  TickStatistics ticks_;
  double started_ = 0.0;  // steady clock [s]
  std::uint64_t dropped_before_ = 0;
  bool was_paused_ = false;
};

}  // namespace constraint_sim
