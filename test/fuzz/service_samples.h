#pragma once

// Valid requests and messages, with names of the scene in service_node.h. The mutator starts from
// their bytes.

#include <constraint_sim/BodiesIn.h>
#include <constraint_sim/CastRay.h>
#include <constraint_sim/ClosestPoints.h>
#include <constraint_sim/EditRecord.h>
#include <constraint_sim/GetBodyState.h>
#include <constraint_sim/LoadScene.h>
#include <constraint_sim/LoadUrdf.h>
#include <constraint_sim/RestoreSnapshot.h>
#include <constraint_sim/SaveSnapshot.h>
#include <geometry_msgs/Twist.h>
#include <geometry_msgs/WrenchStamped.h>
#include <std_msgs/Float64.h>
#include <tf2_msgs/TFMessage.h>
#include <trajectory_msgs/JointTrajectory.h>
#include <visualization_msgs/InteractiveMarkerFeedback.h>

#include <string>
#include <utility>
#include <vector>

#include "constraint_sim/engine/joint.h"
#include "ros/edits.h"

namespace constraint_sim::fuzz {

inline geometry_msgs::Point point(double x, double y, double z) {
  geometry_msgs::Point point;
  point.x = x;
  point.y = y;
  point.z = z;
  return point;
}

// ---- edits: samples(static_cast<Service*>(nullptr)) returns requests of a service

inline std::vector<AddBodyRequest> samples(AddBody*) {
  const std::vector<std::pair<std::uint8_t, std::vector<double>>> shapes{
      {Shape::POINT, {}},           {Shape::SPHERE, {0.2}}, {Shape::BOX, {0.2, 0.3, 0.4}},
      {Shape::CAPSULE, {0.1, 0.3}}, {Shape::PLANE, {}},     {Shape::CYLINDER, {0.2, 0.3}}};
  std::vector<AddBodyRequest> requests;
  for (const auto& [type, dimensions] : shapes) {
    Body& body = requests.emplace_back().body;
    body.name = "new";
    body.type = type == Shape::PLANE ? Body::STATIC : Body::DYNAMIC;
    body.mass = 1.0;
    Shape& shape = body.shapes.emplace_back();
    shape.type = type;
    shape.dimensions = dimensions;
    body.pose.position = point(1.0, 0.0, 0.5);
    body.twist.angular.z = 1.0;
    body.friction = 0.5;
  }
  // A tetrahedron beside the bob.
  requests.push_back(requests[1]);
  Shape& hull = requests.back().body.shapes[0];
  hull.type = Shape::HULL;
  hull.dimensions.clear();
  hull.vertices = {point(0.0, 0.0, 0.0), point(0.4, 0.0, 0.0), point(0.0, 0.4, 0.0),
                   point(0.0, 0.0, 0.4)};
  return requests;
}

inline std::vector<RemoveBodyRequest> samples(RemoveBody*) {
  RemoveBodyRequest request;
  request.name = "bob";
  return {request};
}

inline std::vector<AddDistanceConstraintRequest> samples(AddDistanceConstraint*) {
  AddDistanceConstraintRequest request;
  request.name = "line";
  request.body_b = "bob";
  request.anchor_a = point(0.0, 0.0, 2.0);
  return {request};
}

/// Returns a constraint of any type but the custom ones.
inline Constraint sample_constraint(const std::string& type, engine::JointKind kind) {
  const bool couples = engine::info(kind).couples_joints;
  Constraint constraint;
  constraint.name = "new";
  constraint.type = type;
  constraint.body_a = couples ? "elbow" : "";
  constraint.body_b = couples ? "rail" : "bob";
  if (!couples) constraint.anchor_a = point(0.0, 0.0, 1.0);
  if (engine::info(kind).has_frames) constraint.axis_a.y = 1.0;
  if (engine::info(kind).has_two_axes) constraint.axis_b.x = 1.0;
  if (couples) constraint.coupling.ratio = 1.0;
  if (engine::info(kind).has_pitch) constraint.coupling.pitch = 1.0;
  constraint.free = engine::info(kind).is_free_length;
  if (type == "hinge" || type == "slider" || type == "spring") {
    CoordinateLaw& law = constraint.coordinates.emplace_back();
    law.damping = 1.0;
    if (type == "spring") {
      law.stiffness = 100.0;
    } else {
      law.has_limits = 1;
      law.lower = -1.0;
      law.upper = 1.0;
      law.motor.mode = Motor::RATE;
      law.motor.bias = 0.5;
    }
  }
  return constraint;
}

inline std::vector<AddConstraintRequest> samples(AddConstraint*) {
  std::vector<AddConstraintRequest> requests;
  const auto add = [&](const std::string& type, engine::JointKind kind) {
    requests.emplace_back().constraint = sample_constraint(type, kind);
  };
  const auto add_parameters = [&](const std::vector<std::pair<std::string, double>>& parameters) {
    for (const auto& [name, value] : parameters) {
      Parameter& parameter = requests.back().constraint.parameters.emplace_back();
      parameter.name = name;
      parameter.value = value;
    }
  };
  for (const engine::JointKind kind : engine::joint_kinds()) add(engine::name(kind), kind);
  for (const char* type : {"rope", "strut", "spring"}) add(type, engine::JointKind::kDistance);
  add("custom:test/rod", engine::JointKind::kCustom);
  add_parameters({{"length", 1.0}, {"squared", 0.0}});
  add("custom_force:test/drag", engine::JointKind::kCustomForce);
  add_parameters({{"c", 0.5}, {"wind", 1.0}});
  return requests;
}

inline std::vector<RemoveConstraintRequest> samples(RemoveConstraint*) {
  RemoveConstraintRequest request;
  request.name = "rod";
  return {request};
}

inline std::vector<SetMotorBiasRequest> samples(SetMotorBias*) {
  SetMotorBiasRequest request;
  request.constraint = "elbow";
  request.bias = 0.5;
  request.timeout = 1.0;
  return {request};
}

inline std::vector<SetConstraintPropertiesRequest> samples(SetConstraintProperties*) {
  SetConstraintPropertiesRequest request;
  request.name = "elbow";
  request.keys = {"lower", "upper", "stiffness", "friction"};
  request.values = {-1.0, 1.0, 10.0, 0.1};
  SetConstraintPropertiesRequest enable;
  enable.name = "rail";
  enable.keys = {"enabled"};
  enable.values = {1.0};
  return {request, enable};
}

inline std::vector<ApplyBodyWrenchRequest> samples(ApplyBodyWrench*) {
  ApplyBodyWrenchRequest request;
  request.body_name = "bob";
  request.reference_frame = "arm";
  request.reference_point = point(0.0, 0.1, 0.0);
  request.wrench.force.x = 2.0;
  request.duration = ros::Duration(0.5);
  return {request};
}

inline std::vector<ClearBodyWrenchesRequest> samples(ClearBodyWrenches*) {
  ClearBodyWrenchesRequest request;
  request.body_name = "bob";
  return {request};
}

inline BodyState sample_state() {
  BodyState state;
  state.name = "carrier";
  state.pose.position = point(2.0, 0.0, 0.0);
  state.pose.orientation.w = 1.0;
  state.twist.linear.y = 0.1;
  return state;
}

inline std::vector<SetBodyStateRequest> samples(SetBodyState*) {
  SetBodyStateRequest request;
  request.state = sample_state();
  request.reference_frame = "arm";
  return {request};
}

inline std::vector<ApplyEditsRequest> samples(ApplyEdits*) {
  ApplyEditsRequest request;
  request.remove_constraints = {"rod"};
  request.remove_bodies = {"bob"};
  request.bodies = {samples(static_cast<AddBody*>(nullptr))[1].body};
  request.constraints = {samples(static_cast<AddConstraint*>(nullptr))[0].constraint};
  request.constraints[0].body_b = "new";
  request.states = {sample_state()};
  request.motors.resize(1);
  request.motors[0].constraint = "elbow";
  return {request};
}

inline std::vector<SetBodyPropertiesRequest> samples(SetBodyProperties*) {
  SetBodyPropertiesRequest request;
  request.name = "bob";
  request.keys = {"mass", "inertia_x", "friction", "no_collision"};
  request.values = {2.0, 0.1, 0.3, 0.0};
  return {request};
}

inline std::vector<SetOptionsRequest> samples(SetOptions*) {
  SetOptionsRequest request;
  request.keys = {"method", "time_step", "gravity", "tolerance"};
  request.values = {"sequential_impulses", "0.01", "[0, 0, -9.81]", "1e-6"};
  SetOptionsRequest stiff;
  stiff.keys = {"method", "real_time_factor"};
  stiff.values = {"energy_momentum", "2"};
  return {request, stiff};
}

// ---- other services

inline std::vector<GetBodyStateRequest> samples(GetBodyState*) {
  GetBodyStateRequest request;
  request.name = "bob";
  request.reference_frame = "arm";
  return {request};
}

inline std::vector<CastRayRequest> samples(CastRay*) {
  CastRayRequest request;
  request.origin.x = 5.0;
  request.direction.x = -1.0;
  request.max_distance = 20.0;
  request.reference_frame = "arm";
  request.ignored = {"bob"};
  return {request};
}

inline std::vector<ClosestPointsRequest> samples(ClosestPoints*) {
  ClosestPointsRequest request;
  request.body_a = "bob";
  request.body_b = "arm";
  return {request};
}

inline std::vector<BodiesInRequest> samples(BodiesIn*) {
  BodiesInRequest request;
  request.min = point(-1.0, -1.0, -1.0);
  request.max = point(1.0, 1.0, 1.0);
  return {request};
}

inline std::vector<LoadSceneRequest> samples(LoadScene*) {
  LoadSceneRequest request;
  request.text = "bodies: [{name: bob, mass: 1}]";
  return {request};
}

inline std::vector<LoadUrdfRequest> samples(LoadUrdf*) {
  LoadUrdfRequest request;
  request.text =
      "<robot name='r'><link name='a'/><link name='b'><inertial><mass value='1'/><inertia ixx='1' "
      "iyy='1' izz='1' ixy='0' ixz='0' iyz='0'/></inertial><visual><geometry><sphere radius='1'/>"
      "</geometry></visual></link><joint name='j' type='revolute'><parent link='a'/><child "
      "link='b'/><axis xyz='0 1 0'/><limit lower='-1' upper='1' effort='9' velocity='9'/></joint>"
      "</robot>";
  request.prefix = "r/";
  request.fixed = 1;
  request.extra = "joints: {j: {motor: {bias: 0.1}}}";
  return {request};
}

inline std::vector<SaveSnapshotRequest> samples(SaveSnapshot*) {
  SaveSnapshotRequest request;
  request.name = "kept";
  return {request, SaveSnapshotRequest()};
}

inline std::vector<RestoreSnapshotRequest> samples(RestoreSnapshot*) {
  RestoreSnapshotRequest request;
  request.name = "kept";
  RestoreSnapshotRequest automatic;
  automatic.name = "auto_1";
  return {request, automatic};
}

// ---- messages of topics

inline std::vector<trajectory_msgs::JointTrajectory> samples(trajectory_msgs::JointTrajectory*) {
  trajectory_msgs::JointTrajectory trajectory;
  trajectory.joint_names = {"elbow"};
  trajectory.points.resize(2);
  trajectory.points[0].positions = {0.0};
  trajectory.points[0].velocities = {0.0};
  trajectory.points[1].positions = {0.5};
  trajectory.points[1].velocities = {0.0};
  trajectory.points[1].time_from_start = ros::Duration(1.0);
  return {trajectory};
}

inline std::vector<std_msgs::Float64> samples(std_msgs::Float64*) {
  std_msgs::Float64 value;
  value.data = 0.5;
  return {value};
}

inline std::vector<geometry_msgs::Twist> samples(geometry_msgs::Twist*) {
  geometry_msgs::Twist twist;
  twist.linear.x = 0.5;
  return {twist};
}

inline std::vector<geometry_msgs::WrenchStamped> samples(geometry_msgs::WrenchStamped*) {
  geometry_msgs::WrenchStamped wrench;
  wrench.header.frame_id = "bob";
  wrench.wrench.force.z = 5.0;
  return {wrench};
}

inline std::vector<MotorBias> samples(MotorBias*) {
  MotorBias bias;
  bias.constraint = "elbow";
  bias.bias = 0.3;
  return {bias};
}

inline std::vector<tf2_msgs::TFMessage> samples(tf2_msgs::TFMessage*) {
  tf2_msgs::TFMessage frames;
  for (const double stamp : {0.001, 10.0}) {
    geometry_msgs::TransformStamped& frame = frames.transforms.emplace_back();
    frame.header.frame_id = "world";
    frame.header.stamp = ros::Time(stamp);
    frame.child_frame_id = "hand";
    frame.transform.translation.x = 3.0 + stamp;
    frame.transform.rotation.w = 1.0;
  }
  return {frames};
}

inline std::vector<visualization_msgs::InteractiveMarkerFeedback> samples(
    visualization_msgs::InteractiveMarkerFeedback*) {
  visualization_msgs::InteractiveMarkerFeedback feedback;
  feedback.header.frame_id = "world";
  feedback.marker_name = "bob";
  feedback.control_name = "arm";
  feedback.pose.position = point(0.5, 0.0, 1.0);
  visualization_msgs::InteractiveMarkerFeedback of_frame = feedback;
  of_frame.header.frame_id = "hand";
  return {feedback, of_frame};
}

/// Returns a record of edit_log with changes by drives, as `replay` reads it.
inline std::vector<EditRecord> samples(EditRecord*) {
  DriveChanges changes;
  changes.motors.push_back({"elbow", true, {}});
  changes.states.push_back({"carrier", {}});
  changes.wrenches.push_back({"bob", {}});
  EditRecord record;
  record.service = kDriveRecord;
  record.request = bytes_of(changes);
  return {record};
}

}  // namespace constraint_sim::fuzz
