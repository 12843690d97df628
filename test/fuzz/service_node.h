#pragma once

// The node without its master: the node's own conversions and edits, called on one thread. Queues,
// threads and files of the node are left out.

#include <constraint_sim/BodiesIn.h>
#include <constraint_sim/CastRay.h>
#include <constraint_sim/ClosestPoints.h>
#include <constraint_sim/EditRecord.h>
#include <constraint_sim/GetBodyState.h>
#include <constraint_sim/LoadScene.h>
#include <constraint_sim/LoadUrdf.h>
#include <constraint_sim/RestoreSnapshot.h>
#include <constraint_sim/SaveScene.h>
#include <constraint_sim/SaveSnapshot.h>
#include <constraint_sim/Verify.h>
#include <ros/serialization.h>
#include <ros/time.h>
#include <rosgraph_msgs/Clock.h>
#include <std_msgs/Float64.h>
#include <visualization_msgs/InteractiveMarkerFeedback.h>

#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "checks.h"
#include "constraint_sim/engine/plan.h"
#include "constraint_sim/engine/verify.h"
#include "ros/actuator_efforts.h"
#include "ros/command_changes.h"
#include "ros/constraint_state.h"
#include "ros/conversions.h"
#include "ros/edits.h"
#include "ros/frame_follower.h"
#include "ros/geometry_queries.h"
#include "ros/robots.h"
#include "ros/scenes.h"
#include "ros/snapshots.h"
#include "ros/time_conversions.h"
#include "sim/grip.h"
#include "sim/hand_edits.h"
#include "urdf/robot.h"
#ifdef CONSTRAINT_SIM_DYNAMIC_RECONFIGURE
#include "ros/reconfigure.h"
#endif

namespace constraint_sim::fuzz {

using Bytes = std::vector<std::uint8_t>;

/// Returns the bytes of a message, as they are sent.
template <class Message>
Bytes serialized(const Message& message) {
  Bytes bytes(ros::serialization::serializationLength(message));
  ros::serialization::OStream stream(bytes.data(), static_cast<std::uint32_t>(bytes.size()));
  ros::serialization::serialize(stream, message);
  return bytes;
}

/// A world and the parts of the node that change it. Each function does to the world what the node
/// does with a request or message, on its service threads and on the stepping thread.
class ServiceNode {
 public:
  /// `digest` chooses the expensive checks of this execution.
  explicit ServiceNode(std::uint64_t digest)
      : digest_(digest),
        parameters_(parameters()),
        robots_(parameters_),
        commands_(parameters_, robots_),
        follower_(parameters_),
        world_(first_world()) {
    ros::Time::setNow(ros::Time(1000.0));  // equal in each execution
  }

  // ---- services

  /// Carries out a service of visit_edits(), and repeats an accepted request from its record.
  template <class Response, class Request>
  void edit(const char* service, const Request& request) {
    std::optional<engine::World> other;
    if (replays_) other = world_;
    Response response;
    if (!attempt([&](engine::World& world) { change(world, request, &response); })) return;
    serialized(response);
    if (other) {
      apply_recorded(*other, service, serialized(request));
      require(other->state_hash() == hash_.of(world_),
              std::string(service) + " is replayed to another hash");
    }
    bound_size();
  }
  void step(std::uint32_t steps);
  void get_body_state(const GetBodyStateRequest& request);
  void cast_ray(const CastRayRequest& request);
  void closest_points(const ClosestPointsRequest& request);
  void bodies_in(const BodiesInRequest& request);
  void load_scene(const LoadSceneRequest& request);
  void save_scene();
  void load_urdf(const LoadUrdfRequest& request);
  void save_snapshot(const SaveSnapshotRequest& request);
  void restore_snapshot(const RestoreSnapshotRequest& request);
  void verify(std::uint32_t steps);
  void reset_world();
  void reset_simulation();
#ifdef CONSTRAINT_SIM_DYNAMIC_RECONFIGURE
  void set_parameters(const dynamic_reconfigure::Config& config) {
    edit<SetOptionsResponse>("set_options", request_of(config, config_of(world_.options(), {})));
  }
#endif

  // ---- topics

  void take_trajectory(const trajectory_msgs::JointTrajectory& message) {
    drive_by([&] { return commands_.by_trajectory(message); });
  }
  void take_command(const std_msgs::Float64& message) {
    drive_by([&] { return commands_.by_command("elbow", message.data); });
  }
  void take_twist(const geometry_msgs::Twist& message) {
    drive_by([&] { return commands_.by_twist("carrier", message); });
  }
  void take_wrench(const geometry_msgs::WrenchStamped& message) {
    drive_by([&] { return commands_.by_wrench("bob", message); });
  }
  void take_bias(const MotorBias& message) {
    edit<SetMotorBiasResponse>("set_motor_bias", request_of(message));
  }
  void take_frames(const tf2_msgs::TFMessage& message, bool is_static) {
    Guard guard("tf");
    guard([&] { follower_.frames().take(message, is_static, &guard); });
  }
  void take_clock(const rosgraph_msgs::Clock& message) {
    attempt(
        [&](engine::World& world) { world.set_time(message.clock.toSec(), world.step_count()); });
  }
  void take_feedback(const visualization_msgs::InteractiveMarkerFeedback& feedback);
  /// Applies a record of edit_log, as `replay` does. A rejected record ends the replay, so it may
  /// have changed the world.
  void replay(const EditRecord& record);

  /// Checks that messages about the world can be sent, and that it can be saved.
  void end() {
    send();
    if (is_one_of(4, digest_)) check_snapshot(world_, &hash_);
    if (is_one_of(16, digest_ / 64)) check_saved(world_);
  }

 private:
  static constexpr std::size_t kMostBodies = 12, kMostJoints = 16;
  static constexpr int kMostStoppedSteps = 2;

  static Parameters parameters() {
    Parameters parameters;
    parameters.publish_clock = true;  // stamps are simulated time
    parameters.publish_com = true;
    parameters.follow = "carrier=hand";
    parameters.follow_delay = 0.0;
    return parameters;
  }
  static engine::World first_world();
  static Watchdog& watchdog() {
    static Watchdog one;
    return one;
  }

  bool attempt(const std::function<void(engine::World&)>& change);
  void drive_by(const std::function<CommandChanges::Change()>& change_by);
  void drive(const std::function<void(Driver*)>& act);
  void interrupted(const std::string& by) {
    commands_.end(by);
    robots_.tell_of_gone(world_, by);
  }
  /// Begins again where steps would become expensive.
  void bound_size() {
    if (world_.body_ids().size() <= kMostBodies && world_.joint_ids().size() <= kMostJoints) return;
    world_ = first_world();
    hash_.forget();
  }
  void send() const;

  const std::uint64_t digest_;
  const bool replays_ = is_one_of(8, digest_ / 1024);  // each edit, and computes its hashes
  const bool verifies_ = is_one_of(8, digest_ / 8192);
  int stopped_steps_ = 0;
  Parameters parameters_;
  Robots robots_;
  CommandChanges commands_;
  FrameFollower follower_;
  Snapshots snapshots_;
  engine::World world_;
  KnownHash hash_;
};

inline engine::World ServiceNode::first_world() {
  static const engine::World world = engine::load_scene(R"(
bodies:
- {name: floor, type: static, position: [0, 0, -1], shape: {plane: {}}}
- {name: carrier, type: kinematic, position: [3, 0, 0]}
- {name: arm, mass: 1, position: [0, 0, 0.25], shape: {box: {size: [0.1, 0.1, 0.5]}}}
- {name: bob, mass: 1, position: [0, 0, 1], shape: {sphere: {radius: 0.1}}}
constraints:
- {name: elbow, type: hinge, body_b: arm, axis_a: [0, 1, 0], motor: {bias: 0.1, max_force: 50}}
- {name: rail, type: slider, body_b: carrier, body_a: arm, axis_a: [1, 0, 0], enabled: false}
- {name: rod, type: distance, body_a: arm, anchor_a: [0, 0, 0.25], body_b: bob}
)");
  return world;
}

/// Returns whether a change was accepted. A rejected one must leave the world unchanged.
inline bool ServiceNode::attempt(const std::function<void(engine::World&)>& change) {
  const std::uint64_t before = replays_ ? hash_.of(world_) : 0;
  try {
    change(world_);
    hash_.forget();
    return true;
  } catch (const std::invalid_argument&) {
  }
  require(!replays_ || world_.state_hash() == before, "a rejected edit has changed the world");
  return false;
}

inline void ServiceNode::drive_by(const std::function<CommandChanges::Change()>& change_by) {
  try {
    const CommandChanges::Change change = change_by();
    drive([&](Driver* driver) { change(driver); });
  } catch (const std::invalid_argument&) {
  }
}

/// Changes the world by drives, and repeats the changes from their record.
inline void ServiceNode::drive(const std::function<void(Driver*)>& act) {
  std::optional<engine::World> other;
  if (replays_) other = world_;
  DriveChanges changes;
  Driver driver(&world_, &changes);
  try {
    act(&driver);
  } catch (const std::invalid_argument&) {
  }
  if (changes.empty()) return;
  hash_.forget();
  if (!other) return;
  apply_recorded(*other, kDriveRecord, bytes_of(changes));
  require(other->state_hash() == hash_.of(world_), "a drive is replayed to another hash");
}

/// Steps the world, unless this execution has spent its time on steps that were stopped.
inline void ServiceNode::step(std::uint32_t steps) {
  for (std::uint32_t k = 0; k < steps % 4 && stopped_steps_ < kMostStoppedSteps; ++k) {
    drive([&](Driver* driver) {
      commands_.before_step(driver);
      follower_.before_step(driver, 1.0);
    });
    fuzz::step(&watchdog(), step_interval(digest_, stopped_steps_), &world_, &hash_);
    if (world_.report().outcome.stopped) ++stopped_steps_;
    if (world_.report().outcome.failed) commands_.end("a step that failed");
  }
}

inline void ServiceNode::get_body_state(const GetBodyStateRequest& request) {
  attempt([&](engine::World& world) {
    const engine::BodyId body = find_own_body(world, "name", request.name);
    const engine::BodyId frame = find_body(world, "reference_frame", request.reference_frame);
    serialized(to_msg(world.body(body).name, relative_to(world.state(frame), world.state(body))));
  });
}

inline void ServiceNode::cast_ray(const CastRayRequest& request) {
  attempt([&](engine::World& world) {
    CastRayResponse response;
    constraint_sim::cast_ray(world, request, &response);
    serialized(response);
  });
}

inline void ServiceNode::closest_points(const ClosestPointsRequest& request) {
  attempt([&](engine::World& world) {
    ClosestPointsResponse response;
    constraint_sim::closest_points(world, request, &response);
    serialized(response);
  });
}

inline void ServiceNode::bodies_in(const BodiesInRequest& request) {
  attempt([&](engine::World& world) {
    BodiesInResponse response;
    constraint_sim::bodies_in(world, request, &response);
    serialized(response);
  });
}

inline void ServiceNode::load_scene(const LoadSceneRequest& request) {
  if (request.text.empty()) return;  // the request names a file
  attempt([&](engine::World& world) {
    engine::World scene = load_world("", request.text, parameters_, Caller::kService);
    if (!is_small(scene)) return;
    summary(scene);
    scene.continue_from(world);
    world = std::move(scene);
    interrupted("load_scene");
  });
  bound_size();
}

inline void ServiceNode::save_scene() {
  SaveSceneResponse response;
  response.text = engine::save_scene(world_);
  serialized(response);
}

inline void ServiceNode::load_urdf(const LoadUrdfRequest& request) {
  if (request.text.empty()) return;
  attempt([&](engine::World& world) {
    RobotOptions options;
    options.prefix = request.prefix;
    options.pose = from_msg(request.pose, geometry_msgs::Twist());
    options.fixed = request.fixed;
    options.extra = request.extra;
    const Robot robot = add_robot(build_robot(request.text, options), &world);
    robots_.add(robot, {request.text, {}}, request.prefix, world);
  });
  bound_size();
}

inline void ServiceNode::save_snapshot(const SaveSnapshotRequest& request) {
  attempt([&](engine::World& world) {
    auto bytes = std::make_shared<const std::string>(engine::write_snapshot(world));
    SaveSnapshotResponse response;
    response.name = snapshots_.keep({request.name, false, world.time(), world.step_count(),
                                     world.state_hash(), std::move(bytes)});
    serialized(response);
  });
}

inline void ServiceNode::restore_snapshot(const RestoreSnapshotRequest& request) {
  attempt([&](engine::World& world) {
    engine::World restored = engine::read_snapshot(*snapshots_.bytes(request.name));
    for (const Snapshots::Snapshot& kept : snapshots_.list())
      require(kept.name != request.name || kept.hash == restored.state_hash(),
              "a restored world has another hash");
    restored.reserve_ids(world);
    world = std::move(restored);
    interrupted("restore_snapshot");
  });
}

/// Verifies the world, which steps five copies, in a share of the executions.
inline void ServiceNode::verify(std::uint32_t steps) {
  if (!verifies_ || stopped_steps_ >= kMostStoppedSteps) return;
  attempt([&](engine::World& world) {
    engine::VerifyOptions options;
    options.ticks = steps % 4;
    watchdog().start(step_interval(digest_, stopped_steps_));
    options.stop = watchdog().flag();
    VerifyResponse response;
    const engine::VerifyReport report = engine::verify(world, options);
    if (report.stopped) ++stopped_steps_;
    response.table = engine::to_table(report);
    serialized(response);
  });
}

inline void ServiceNode::reset_world() {
  attempt([&](engine::World& world) {
    constraint_sim::reset_world(world);
    interrupted("reset_world");
  });
}

inline void ServiceNode::reset_simulation() {
  attempt([&](engine::World& world) {
    constraint_sim::reset_simulation(world);
    interrupted("reset_simulation");
  });
}

/// Carries out drags and menu entries of rviz.
inline void ServiceNode::take_feedback(
    const visualization_msgs::InteractiveMarkerFeedback& feedback) {
  const std::string& body = feedback.marker_name;
  attempt([&](engine::World& world) {
    const Eigen::Vector3d target = from_msg(feedback.pose.position);
    const auto pose =
        follower_.frames().look_up(parameters_.world_frame, feedback.header.frame_id, ros::Time(0));
    switch (feedback.menu_entry_id % 6) {
      case 0:
        if (!pose) return;
        return drag(&world, body,
                    from_msg(pose->translation) + from_msg(pose->rotation).normalized() * target);
      case 1:
        return let_go(&world, body);
      case 2:
        return fix(&world, body);
      case 3:
        return release(&world, body);
      case 4:
        return push(&world, body, Eigen::Vector3d::UnitX());
      default:
        return join(&world, body, feedback.control_name);
    }
  });
  bound_size();
}

inline void ServiceNode::replay(const EditRecord& record) {
  try {
    apply_recorded(world_, record.service, record.request);
  } catch (const std::invalid_argument&) {
  }
  hash_.forget();
  bound_size();
}

/// Makes the messages that the node publishes about each body, joint and contact.
inline void ServiceNode::send() const {
  tf2_msgs::TFMessage frames;
  for (const engine::BodyId id : world_.body_ids()) {
    const BodyState state = to_msg(world_.body(id).name, world_.state(id));
    serialized(state);
    require(std::isfinite(state.pose.position.x) && std::isfinite(state.pose.orientation.w) &&
                std::isfinite(state.twist.linear.x) && std::isfinite(state.twist.angular.x),
            "a message has a number that is not finite");
    robots_.add_frames(world_, id, ros::Time(1.0), &frames);
  }
  serialized(frames);
  MarkerSet markers(parameters_.world_frame);
  markers.begin(ros::Time(1.0), true);
  robots_.add_markers(world_, true, &markers.in("robots"));
  markers.finish();
  const ActuatorEfforts efforts(world_);
  for (const engine::JointId id : world_.joint_ids()) {
    serialized(to_msg(world_, id));
    sensor_msgs::JointState coordinates;
    add_coordinates(world_.joint(id), world_.joint_state(id), efforts.of(id), &coordinates);
    serialized(coordinates);
  }
  for (const engine::Contact& contact : world_.contacts()) {
    serialized(to_msg(world_, contact));
    serialized(to_force_msg(world_, contact));
  }
}

}  // namespace constraint_sim::fuzz
