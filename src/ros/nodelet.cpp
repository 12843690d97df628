#include <nodelet/nodelet.h>

#include <memory>
#include <pluginlib/class_list_macros.hpp>
#include <stdexcept>

#include "ros/simulator_node.h"

namespace constraint_sim {

/// The simulator as a nodelet, on its own queues and threads.
class SimulatorNodelet : public nodelet::Nodelet {
 private:
  void onInit() override {
    try {
      simulator_ = std::make_unique<SimulatorNode>(getNodeHandle(), getPrivateNodeHandle());
    } catch (const std::invalid_argument& error) {
      NODELET_FATAL("%s", error.what());
      throw;  // makes the manager refuse the nodelet
    }
  }

  std::unique_ptr<SimulatorNode> simulator_;
};

}  // namespace constraint_sim

PLUGINLIB_EXPORT_CLASS(constraint_sim::SimulatorNodelet, nodelet::Nodelet)
