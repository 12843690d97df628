#pragma once

#include <ros/callback_queue.h>
#include <ros/node_handle.h>
#include <ros/spinner.h>
#include <ros/subscriber.h>
#include <rosgraph_msgs/Clock.h>

#include <thread>

#include "ros/parameters.h"
#include "ros/publishers.h"
#include "ros/services.h"
#include "sim/stepper.h"

namespace constraint_sim {

/// The simulator as a ROS node: a stepper on a thread of its own, services on a queue of their own
/// that edit its world, and topics that show it. Runs from construction to destruction.
class SimulatorNode {
 public:
  /// Throws std::invalid_argument for a parameter or scene that cannot be.
  SimulatorNode(const ros::NodeHandle& handle, const ros::NodeHandle& private_handle);
  ~SimulatorNode();
  SimulatorNode(const SimulatorNode&) = delete;
  SimulatorNode& operator=(const SimulatorNode&) = delete;

 private:
  StepperEvents events();
  Stepper::Clock clock() const;
  void on_clock(const rosgraph_msgs::Clock& message);

  ros::CallbackQueue queue_;
  ros::NodeHandle handle_;
  ros::NodeHandle private_handle_;
  Parameters parameters_;
  Publishers publishers_;
  Stepper stepper_;
  Services services_;
  ros::Subscriber clock_topic_;
  double clock_ = 0.0;  // [s] that /clock said last
  ros::AsyncSpinner spinner_;
  std::thread stepping_thread_;
};

}  // namespace constraint_sim
