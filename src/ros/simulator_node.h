#pragma once

#include <ros/node_handle.h>

#include <memory>

#include "ros/parameters.h"

namespace constraint_sim {

/// The simulator as a ROS node: a stepper on its own thread, services on their own queues that edit
/// its world, topics that show it, and a log. Runs from construction to destruction.
class SimulatorNode {
 public:
  /// Throws ParameterError for an invalid parameter or scene.
  SimulatorNode(const ros::NodeHandle& handle, const ros::NodeHandle& private_handle);
  /// Answers all waiting callers.
  ~SimulatorNode();
  SimulatorNode(const SimulatorNode&) = delete;
  SimulatorNode& operator=(const SimulatorNode&) = delete;

  const Parameters& parameters() const;

 private:
  class Impl;  // files that include this header do without all that a node includes
  std::unique_ptr<Impl> impl_;
};

}  // namespace constraint_sim
