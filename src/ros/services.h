#pragma once

#include <constraint_sim/ApplyEdits.h>
#include <constraint_sim/BodiesIn.h>
#include <constraint_sim/CastRay.h>
#include <constraint_sim/ClosestPoints.h>
#include <constraint_sim/GetBodyState.h>
#include <constraint_sim/GetWorldProperties.h>
#include <constraint_sim/ListScenes.h>
#include <constraint_sim/LoadScene.h>
#include <constraint_sim/MotorBias.h>
#include <constraint_sim/SaveScene.h>
#include <constraint_sim/SetOptions.h>
#include <constraint_sim/Step.h>
#include <ros/node_handle.h>
#include <ros/publisher.h>
#include <std_msgs/Header.h>
#include <std_srvs/Empty.h>

#include <string>
#include <vector>

#include "ros/edit_log.h"
#include "ros/guarded.h"
#include "ros/parameters.h"
#include "ros/publishers.h"
#include "ros/robots.h"
#include "ros/snapshot_services.h"
#include "sim/stepper.h"

namespace constraint_sim {

/// Private handles, each with its own queue and threads, so that a waiting call of one does not
/// block the others.
struct ServiceHandles {
  ros::NodeHandle edits;
  ros::NodeHandle queries;
  ros::NodeHandle steps;  ///< a call may wait for as long as its caller wants
  ros::NodeHandle pauses;
};

/// The node's services. Each translates a request into an edit of the stepper's world and waits
/// until the edit has taken effect. The topic motor_bias also edits, without waiting.
class Services {
 public:
  Services(Stepper& stepper, EditLog& edit_log, Publishers& publishers, Robots& robots,
           const Parameters& parameters, ServiceHandles handles);

  /// Runs the service set_options; waits for the stepping thread.
  SetOptionsResponse set_options(SetOptionsRequest& request);

 private:
  /// Handles a service of visit_edits(). Divides the meshes of the request.
  template <class Request, class Response>
  bool edit(const char* service, Request& request, Response& response);
  /// Returns whether an edit may take long.
  template <class Request>
  static Stepper::Duration duration_of(const Request&) {
    return Stepper::Duration::kShort;
  }
  static Stepper::Duration duration_of(const ApplyEditsRequest& request);
  /// Applies settings of a request that are not of the world. Stepping thread only.
  template <class Request>
  void follow(const Request&) {}
  void follow(const SetOptionsRequest& request);
  bool list_scenes(ListScenesRequest& request, ListScenesResponse& response);
  void set_motor_bias(const MotorBias& message, const SharedGuard& guard);
  bool get_body_state(GetBodyStateRequest& request, GetBodyStateResponse& response);
  bool cast_ray(CastRayRequest& request, CastRayResponse& response);
  bool closest_points(ClosestPointsRequest& request, ClosestPointsResponse& response);
  bool bodies_in(BodiesInRequest& request, BodiesInResponse& response);
  /// Returns the header of an answer in the frame of a body.
  std_msgs::Header header_in(const World& world, const std::string& reference_frame) const;
  bool load_scene(LoadSceneRequest& request, LoadSceneResponse& response);
  void tell_scene(const std::string& path);
  bool save_scene(SaveSceneRequest& request, SaveSceneResponse& response);
  bool pause_physics(std_srvs::EmptyRequest& request, std_srvs::EmptyResponse& response);
  bool unpause_physics(std_srvs::EmptyRequest& request, std_srvs::EmptyResponse& response);
  bool reset_world(std_srvs::EmptyRequest& request, std_srvs::EmptyResponse& response);
  bool reset_simulation(std_srvs::EmptyRequest& request, std_srvs::EmptyResponse& response);
  bool step(StepRequest& request, StepResponse& response);
  bool get_world_properties(GetWorldPropertiesRequest& request,
                            GetWorldPropertiesResponse& response);

  Stepper& stepper_;
  EditLog& edit_log_;
  Publishers& publishers_;
  Robots& robots_;
  Parameters parameters_;
  SnapshotServices snapshots_;
  std::vector<ros::ServiceServer> servers_;
  ros::Subscriber motor_bias_;
  ros::Publisher scene_topic_;
};

}  // namespace constraint_sim
