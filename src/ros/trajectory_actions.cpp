#include "ros/trajectory_actions.h"

#include <actionlib/server/action_server_base.h>
#include <actionlib/server/server_goal_handle.h>
#include <actionlib_msgs/GoalStatusArray.h>
#include <control_msgs/FollowJointTrajectoryAction.h>
#include <ros/publisher.h>
#include <ros/subscriber.h>

#include <algorithm>
#include <boost/make_shared.hpp>
#include <optional>
#include <utility>

#include "engine/model/validate.h"
#include "ros/command_changes.h"
#include "ros/guarded.h"
#include "sim/errors.h"
#include "sim/words.h"

namespace constraint_sim {
namespace {

using Action = control_msgs::FollowJointTrajectoryAction;
using GoalHandle = actionlib::ServerGoalHandle<Action>;
using Result = control_msgs::FollowJointTrajectoryResult;
using control_msgs::JointTolerance;

constexpr std::uint32_t kActionQueue = 50;
constexpr double kStatusPeriod = 0.2;   // as actionlib has it [s]
constexpr double kStatusTimeout = 5.0;  // time for which the status of an ended goal is sent [s]
constexpr double kRemovedTime = 1.0;    // time for the results of a removed robot to be sent [s]
// Rate below which a joint stands at the end, as in ros_control [m/s or rad/s].
constexpr double kStoppedVelocity = 0.01;

/// Sets the tolerances of a list. As its type says, 0 is the default, and a negative number is
/// none.
void set_tolerances(const char* field, const std::vector<JointTolerance>& list,
                    const std::vector<std::string>& joints,
                    std::vector<constraint_sim::JointTolerance>* tolerances) {
  const auto set = [&](double value, double* tolerance) {
    engine::check_finite(field, value);
    if (value != 0.0) *tolerance = std::max(value, 0.0);
  };
  for (const JointTolerance& given : list) {
    const auto found = std::find(joints.begin(), joints.end(), given.name);
    if (found == joints.end())
      throw TrajectoryError(
          TrajectoryError::Field::kJoints,
          std::string(field) + ": joint '" + shortened(given.name) + "' is not in the trajectory");
    auto& tolerance = (*tolerances)[static_cast<std::size_t>(found - joints.begin())];
    set(given.position, &tolerance.position);
    set(given.velocity, &tolerance.velocity);
  }
}

TrajectoryGoal goal_of(const control_msgs::FollowJointTrajectoryGoal& message,
                       const RobotDescription& robot, const GoalDefaults& defaults) {
  TrajectoryGoal goal;
  goal.trajectory = trajectory_from_msg(message.trajectory);
  const std::vector<std::string>& joints = goal.trajectory.joints;
  for (const std::string& joint : joints)
    if (robot.joints->count(joint) == 0)
      throw TrajectoryError(
          TrajectoryError::Field::kJoints,
          "joint_names: robot '" + robot.name + "' has no joint '" + shortened(joint) + "'");
  goal.path.resize(joints.size());
  goal.goal.assign(joints.size(), {defaults.tolerance, kStoppedVelocity});
  set_tolerances("path_tolerance", message.path_tolerance, joints, &goal.path);
  set_tolerances("goal_tolerance", message.goal_tolerance, joints, &goal.goal);
  const double time = message.goal_time_tolerance.toSec();
  goal.goal_time = time == 0.0 ? defaults.time : std::max(time, 0.0);
  return goal;
}

Result result_of_exception() {
  Result result;
  result.error_string = message_of_exception();
  result.error_code = Result::INVALID_GOAL;
  try {
    throw;
  } catch (const TrajectoryError& error) {
    result.error_code = error.field() == TrajectoryError::Field::kJoints
                            ? Result::INVALID_JOINTS
                            : Result::OLD_HEADER_TIMESTAMP;
  } catch (...) {
  }
  return result;
}

}  // namespace

/// Action server of one robot. The protocol is actionlib's; subscriptions are guarded.
class TrajectoryActions::Server : public actionlib::ActionServerBase<Action> {
 public:
  Server(const RobotDescription& described, const ros::NodeHandle& robots)
      : ActionServerBase<Action>({}, {}),
        robot(described),
        handle_(robots, described.name + "/follow_joint_trajectory"),
        status_(handle_.advertise<actionlib_msgs::GoalStatusArray>("status", kActionQueue, true)),
        feedback_(handle_.advertise<control_msgs::FollowJointTrajectoryActionFeedback>(
            "feedback", kActionQueue)),
        result_(handle_.advertise<control_msgs::FollowJointTrajectoryActionResult>("result",
                                                                                   kActionQueue)) {
    status_list_timeout_ = ros::Duration(kStatusTimeout);
  }
  Server(const Server&) = delete;
  Server& operator=(const Server&) = delete;

  void publishStatus() override {
    const boost::recursive_mutex::scoped_lock lock(lock_);
    actionlib_msgs::GoalStatusArray message;
    message.header.stamp = ros::Time::now();
    for (auto next = status_list_.begin(); next != status_list_.end();) {
      message.status_list.push_back(next->status_);
      // actionlib keeps a cancel without a stamp, and without its goal, for ever
      if (next->handle_destruction_time_.isZero() && next->handle_tracker_.expired())
        next->handle_destruction_time_ = message.header.stamp;
      const bool is_old =
          !next->handle_destruction_time_.isZero() &&
          next->handle_destruction_time_ + status_list_timeout_ < message.header.stamp;
      next = is_old ? status_list_.erase(next) : std::next(next);
    }
    status_.publish(message);
  }
  /// Takes no more requests.
  void close() {
    goals_.shutdown();
    cancels_.shutdown();
  }
  bool has_listener_to_feedback() const { return feedback_.getNumSubscribers() > 0; }

  const RobotDescription robot;

 protected:
  void initialize() override {
    goals_ = guarded_subscribe<ActionGoal>(handle_, make_guard("goal"), kActionQueue,
                                           [this](const ActionGoal& message) {
                                             goalCallback(boost::make_shared<ActionGoal>(message));
                                           });
    cancels_ = guarded_subscribe<actionlib_msgs::GoalID>(
        handle_, make_guard("cancel"), kActionQueue, [this](const actionlib_msgs::GoalID& message) {
          cancelCallback(boost::make_shared<actionlib_msgs::GoalID>(message));
        });
  }
  void publishResult(const actionlib_msgs::GoalStatus& status, const Result& result) override {
    ActionResult message;
    message.header.stamp = ros::Time::now();
    message.status = status;
    message.result = result;
    result_.publish(message);
    publishStatus();
  }
  void publishFeedback(const actionlib_msgs::GoalStatus& status,
                       const Feedback& feedback) override {
    ActionFeedback message;
    message.header = feedback.header;
    message.status = status;
    message.feedback = feedback;
    feedback_.publish(message);
  }

 private:
  ros::NodeHandle handle_;
  ros::Publisher status_, feedback_, result_;
  ros::Subscriber goals_, cancels_;
};

struct TrajectoryActions::Goals {
  std::mutex mutex;
  std::map<Id, GoalHandle> handles;

  void add(Id id, const GoalHandle& handle) {
    const std::lock_guard<std::mutex> lock(mutex);
    handles.emplace(id, handle);
  }
  std::optional<GoalHandle> find(Id id) {
    const std::lock_guard<std::mutex> lock(mutex);
    const auto found = handles.find(id);
    return found == handles.end() ? std::nullopt : std::optional<GoalHandle>(found->second);
  }
  std::optional<Id> find(const GoalHandle& handle) {
    const std::lock_guard<std::mutex> lock(mutex);
    for (const auto& [id, other] : handles)
      if (other == handle) return id;
    return std::nullopt;
  }
  std::optional<GoalHandle> take(Id id) {
    const std::optional<GoalHandle> handle = find(id);
    const std::lock_guard<std::mutex> lock(mutex);
    handles.erase(id);
    return handle;
  }
};

TrajectoryActions::TrajectoryActions(const Parameters& parameters,
                                     const ros::NodeHandle& private_handle)
    : defaults_{parameters.goal_tolerance, parameters.goal_time_tolerance},
      handle_(private_handle, "robots"),
      goals_(std::make_unique<Goals>()) {
  timer_ = guarded_timer(handle_, make_guard("follow_joint_trajectory"), kStatusPeriod,
                         [this] { tend(); });
}

TrajectoryActions::~TrajectoryActions() { stop(); }

void TrajectoryActions::start(Receivers receivers) { receivers_ = std::move(receivers); }

void TrajectoryActions::stop() {
  timer_.stop();
  Servers servers;  // destroyed after the lock, since that waits for callbacks
  Removed removed;
  const std::lock_guard<std::mutex> lock(mutex_);
  servers.swap(servers_);
  removed.swap(removed_);
}

// ---- publishing thread, which alone adds and removes servers

void TrajectoryActions::update(const std::vector<RobotDescription>& robots) {
  Servers next;
  for (const RobotDescription& robot : robots) {
    if (robot.joints->empty()) continue;
    const auto known = servers_.find(robot.name);
    const bool is_known = known != servers_.end() && known->second->robot.text == robot.text;
    next.emplace(robot.name, is_known ? known->second : make_server(robot));
  }
  const double until = ros::SteadyTime::now().toSec() + kRemovedTime;
  const std::lock_guard<std::mutex> lock(mutex_);
  for (const auto& [name, server] : servers_) {
    const auto kept = next.find(name);
    if (kept != next.end() && kept->second == server) continue;
    server->close();
    removed_.emplace_back(until, server);
  }
  servers_.swap(next);
}

std::shared_ptr<TrajectoryActions::Server> TrajectoryActions::make_server(
    const RobotDescription& robot) {
  const auto server = std::make_shared<Server>(robot, handle_);
  server->registerGoalCallback([this, robot](const GoalHandle& handle) {
    const Id id = ++last_id_;
    goals_->add(id, handle);
    try {
      receivers_.begin(id, goal_of(*handle.getGoal(), robot, defaults_));
    } catch (...) {
      reject(id);
    }
  });
  server->registerCancelCallback([this](const GoalHandle& handle) {
    if (const auto id = goals_->find(handle)) receivers_.cancel(*id);
  });
  server->start();
  return server;
}

// ---- timer

// Publishes the status of all goals, and drops the servers of robots that were removed long ago.
void TrajectoryActions::tend() {
  std::vector<std::shared_ptr<Server>> present;
  Removed old;
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    for (const auto& [name, server] : servers_) present.push_back(server);
    const double now = ros::SteadyTime::now().toSec();
    const auto first_old = std::partition(removed_.begin(), removed_.end(),
                                          [&](const auto& entry) { return entry.first > now; });
    old.assign(first_old, removed_.end());
    removed_.erase(first_old, removed_.end());
  }
  for (const std::shared_ptr<Server>& server : present) server->publishStatus();
}

// ---- any thread

void TrajectoryActions::accept(Id id) {
  if (auto handle = goals_->find(id)) handle->setAccepted();
}

void TrajectoryActions::reject(Id id) {
  const Result result = result_of_exception();
  if (auto handle = goals_->take(id)) handle->setRejected(result, result.error_string);
}

void TrajectoryActions::finish(const TrajectoryGoals::End& end) {
  using Cause = TrajectoryGoals::Cause;
  auto handle = goals_->take(end.id);
  if (!handle) return;
  Result result;
  result.error_string = end.why;
  switch (end.cause) {
    case Cause::kReached:
      return handle->setSucceeded(result, end.why);
    case Cause::kReplaced:
      return handle->setCanceled(result, end.why);
    case Cause::kPathViolated:
      result.error_code = Result::PATH_TOLERANCE_VIOLATED;
      break;
    case Cause::kGoalViolated:
      result.error_code = Result::GOAL_TOLERANCE_VIOLATED;
      break;
    case Cause::kLost:
      result.error_code = Result::INVALID_JOINTS;
  }
  handle->setAborted(result, end.why);
}

bool TrajectoryActions::anybody_listens_to_feedback() const {
  const std::lock_guard<std::mutex> lock(mutex_);
  return std::any_of(servers_.begin(), servers_.end(),
                     [](const auto& entry) { return entry.second->has_listener_to_feedback(); });
}

void TrajectoryActions::show(const TrajectoryGoals::Progress& progress, const ros::Time& stamp) {
  auto handle = goals_->find(progress.id);
  if (!handle) return;
  control_msgs::FollowJointTrajectoryFeedback message;
  message.header.stamp = stamp;
  for (const TrajectoryGoals::Progress::Joint& joint : progress.joints) {
    message.joint_names.push_back(joint.name);
    message.desired.positions.push_back(joint.desired_position);
    message.desired.velocities.push_back(joint.desired_velocity);
    message.actual.positions.push_back(joint.position);
    message.actual.velocities.push_back(joint.velocity);
    message.error.positions.push_back(joint.desired_position - joint.position);
    message.error.velocities.push_back(joint.desired_velocity - joint.velocity);
  }
  const ros::Duration time(std::clamp(progress.time, -1e9, 1e9));
  message.desired.time_from_start = message.actual.time_from_start = message.error.time_from_start =
      time;
  handle->publishFeedback(message);
}

}  // namespace constraint_sim
