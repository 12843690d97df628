#pragma once

#include <constraint_sim/LoadUrdf.h>
#include <ros/node_handle.h>

#include "ros/parameters.h"
#include "ros/robots.h"
#include "sim/stepper.h"

namespace constraint_sim {

/// Adds the robot named by the parameters, if any, to the first world. Throws ParameterError.
void add_first_robot(const ros::NodeHandle& handle, const ros::NodeHandle& private_handle,
                     const Parameters& parameters, Robots* robots, World* world);

/// The service load_urdf.
class UrdfLoader {
 public:
  UrdfLoader(Stepper& stepper, const Parameters& parameters, Robots& robots,
             ros::NodeHandle handle);

 private:
  bool load(LoadUrdfRequest& request, LoadUrdfResponse& response);

  Stepper& stepper_;
  Parameters parameters_;
  Robots& robots_;
  ros::ServiceServer server_;
};

}  // namespace constraint_sim
