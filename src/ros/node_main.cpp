#include <ros/ros.h>

#include <stdexcept>

#include "ros/simulator_node.h"

int main(int argc, char** argv) {
  ros::init(argc, argv, "constraint_sim");
  try {
    const constraint_sim::SimulatorNode node(ros::NodeHandle(), ros::NodeHandle("~"));
    ros::waitForShutdown();
  } catch (const std::invalid_argument& error) {
    ROS_FATAL("%s", error.what());
    return 2;
  }
}
