#pragma once

#include <constraint_sim/AddBody.h>
#include <constraint_sim/AddConstraint.h>
#include <constraint_sim/AddDistanceConstraint.h>
#include <constraint_sim/ApplyBodyWrench.h>
#include <constraint_sim/ClearBodyWrenches.h>
#include <constraint_sim/GetBodyState.h>
#include <constraint_sim/GetWorldProperties.h>
#include <constraint_sim/LoadScene.h>
#include <constraint_sim/MotorBias.h>
#include <constraint_sim/RemoveBody.h>
#include <constraint_sim/RemoveConstraint.h>
#include <constraint_sim/SaveScene.h>
#include <constraint_sim/SetBodyState.h>
#include <constraint_sim/SetConstraintProperties.h>
#include <constraint_sim/SetMotorBias.h>
#include <constraint_sim/Step.h>
#include <ros/node_handle.h>
#include <std_srvs/Empty.h>

#include <atomic>
#include <vector>

#include "ros/parameters.h"
#include "ros/publishers.h"
#include "sim/stepper.h"

namespace constraint_sim {

/// Private handles, each with a queue and threads of its own, so that who waits in one does not
/// keep the others waiting.
struct ServiceHandles {
  ros::NodeHandle edits;
  ros::NodeHandle queries;
  ros::NodeHandle steps;  ///< waits for as long as its caller wants
  ros::NodeHandle pauses;
};

/// The node's services: each translates a request into an edit of the stepper's world and waits
/// until it has taken effect. Also the one topic that edits, motor_bias, which does not wait.
class Services {
 public:
  Services(Stepper& stepper, const Publishers& publishers, const Parameters& parameters,
           ServiceHandles handles);

 private:
  bool add_body(AddBodyRequest& request, AddBodyResponse& response);
  bool remove_body(RemoveBodyRequest& request, RemoveBodyResponse& response);
  bool add_distance_constraint(AddDistanceConstraintRequest& request,
                               AddDistanceConstraintResponse& response);
  bool add_constraint(AddConstraintRequest& request, AddConstraintResponse& response);
  bool remove_constraint(RemoveConstraintRequest& request, RemoveConstraintResponse& response);
  bool set_motor_bias(SetMotorBiasRequest& request, SetMotorBiasResponse& response);
  bool set_constraint_properties(SetConstraintPropertiesRequest& request,
                                 SetConstraintPropertiesResponse& response);
  void on_motor_bias(const MotorBias& message);
  void tell_of_motor(const char* why);
  bool apply_body_wrench(ApplyBodyWrenchRequest& request, ApplyBodyWrenchResponse& response);
  bool clear_body_wrenches(ClearBodyWrenchesRequest& request, ClearBodyWrenchesResponse& response);
  bool get_body_state(GetBodyStateRequest& request, GetBodyStateResponse& response);
  bool set_body_state(SetBodyStateRequest& request, SetBodyStateResponse& response);
  bool load_scene(LoadSceneRequest& request, LoadSceneResponse& response);
  bool save_scene(SaveSceneRequest& request, SaveSceneResponse& response);
  bool pause_physics(std_srvs::EmptyRequest& request, std_srvs::EmptyResponse& response);
  bool unpause_physics(std_srvs::EmptyRequest& request, std_srvs::EmptyResponse& response);
  bool reset_world(std_srvs::EmptyRequest& request, std_srvs::EmptyResponse& response);
  bool reset_simulation(std_srvs::EmptyRequest& request, std_srvs::EmptyResponse& response);
  bool step(StepRequest& request, StepResponse& response);
  bool get_world_properties(GetWorldPropertiesRequest& request,
                            GetWorldPropertiesResponse& response);

  Stepper& stepper_;
  const Publishers& publishers_;
  Parameters parameters_;
  std::atomic<double> told_of_motor_{-1e9};  // [s]
  std::vector<ros::ServiceServer> servers_;
  ros::Subscriber motor_bias_;
};

}  // namespace constraint_sim
