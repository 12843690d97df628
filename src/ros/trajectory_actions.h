#pragma once

#include <ros/node_handle.h>
#include <ros/steady_timer.h>
#include <ros/time.h>

#include <atomic>
#include <functional>
#include <map>
#include <memory>
#include <mutex>
#include <string>
#include <utility>
#include <vector>

#include "ros/parameters.h"
#include "ros/robots.h"
#include "sim/trajectory_goals.h"

namespace constraint_sim {

/// Tolerances of goals that do not set them; 0: none.
struct GoalDefaults {
  double tolerance = 0.0;  ///< error of a joint at the end [m or rad]
  double time = 0.0;       ///< time after the end [s]
};

/// The action servers robots/<robot>/follow_joint_trajectory (control_msgs/FollowJointTrajectory),
/// by which MoveIt moves robots. A goal has an Id from its arrival until its result. A robot has
/// several active goals if they have no joint in common.
class TrajectoryActions {
 public:
  using Id = TrajectoryGoals::Id;
  /// Receivers of clients' requests, on subscriber threads.
  struct Receivers {
    std::function<void(Id, const TrajectoryGoal&)> begin;  ///< answers by accept() or reject()
    std::function<void(Id)> cancel;
  };

  TrajectoryActions(const Parameters& parameters, const ros::NodeHandle& private_handle);
  ~TrajectoryActions();
  TrajectoryActions(const TrajectoryActions&) = delete;
  TrajectoryActions& operator=(const TrajectoryActions&) = delete;

  /// Call before any robot is known.
  void start(Receivers receivers);
  /// Ends all servers. No receiver is called afterwards.
  void stop();

  /// Starts servers of new robots, and ends those of removed ones. Publishing thread.
  void update(const std::vector<RobotDescription>& robots);

  // ---- any thread
  void accept(Id id);
  /// Rejects a goal for the present exception. Call only within a catch block.
  void reject(Id id);
  void finish(const TrajectoryGoals::End& end);
  bool anybody_listens_to_feedback() const;
  void show(const TrajectoryGoals::Progress& progress, const ros::Time& stamp);

 private:
  class Server;
  struct Goals;                                                    // handles of goals by id
  using Servers = std::map<std::string, std::shared_ptr<Server>>;  // by the robot's name
  /// Servers of removed robots, and the steady time until which their results are sent [s].
  using Removed = std::vector<std::pair<double, std::shared_ptr<Server>>>;

  std::shared_ptr<Server> make_server(const RobotDescription& robot);
  void tend();

  GoalDefaults defaults_;
  ros::NodeHandle handle_;
  Receivers receivers_;
  std::atomic<Id> last_id_{0};
  std::unique_ptr<Goals> goals_;
  mutable std::mutex mutex_;  // protects servers_, which one thread alone changes, and removed_
  Servers servers_;
  Removed removed_;
  ros::SteadyTimer timer_;
};

}  // namespace constraint_sim
