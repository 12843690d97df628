#include <ros/ros.h>

#include <iostream>
#include <stdexcept>

#include "ros/simulator_node.h"

int main(int argc, char** argv) {
  ros::init(argc, argv, "constraint_sim");
  try {
    const constraint_sim::SimulatorNode node(ros::NodeHandle(), ros::NodeHandle("~"));
    ros::waitForShutdown();
  } catch (const std::invalid_argument& error) {
    // rosconsole may be set to say nothing, and a node that does not start must say why
    std::cerr << ros::this_node::getName() << ": " << error.what() << std::endl;
    return 2;
  }
}
