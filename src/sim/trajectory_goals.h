#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "constraint_sim/engine/world.h"
#include "sim/trajectories.h"

namespace constraint_sim {

/// Deviation of a joint from its trajectory, each ≥ 0; 0: any.
struct JointTolerance {
  double position = 0.0;  ///< [m or rad]
  double velocity = 0.0;  ///< [m/s or rad/s]
};

/// A trajectory that has to be followed to tolerances.
struct TrajectoryGoal {
  JointTrajectory trajectory;
  std::vector<JointTolerance> path;  ///< one for each joint, until the end of the trajectory
  std::vector<JointTolerance> goal;  ///< one for each joint, at the end
  double goal_time = 0.0;  ///< time after the end until all joints are within `goal` [s] ≥ 0
};

/// Watches joints that follow trajectories, and tells how each goal ends. A goal ends early where
/// another goal, message or command takes one of its joints. Stepping thread only.
class TrajectoryGoals {
 public:
  using Id = std::uint64_t;
  enum class Cause {
    kReached,       ///< all joints are within their tolerances at the end
    kReplaced,      ///< another motion takes a joint, or the goal was cancelled
    kPathViolated,  ///< a joint left its trajectory by more than its tolerance
    kGoalViolated,  ///< a joint is not within its tolerance in time
    kLost           ///< a joint is gone, or its motor cannot follow
  };
  struct End {
    Id id;
    Cause cause;
    std::string why;
  };
  /// Desired and present motion of the joints of a goal.
  struct Progress {
    struct Joint {
      std::string name;
      double desired_position, desired_velocity;  ///< [m or rad] and per second
      double position, velocity;
    };
    Id id;
    double time;  ///< since the start of the trajectory [s]
    std::vector<Joint> joints;
  };

  explicit TrajectoryGoals(Trajectories* trajectories) : trajectories_(*trajectories) {}

  /// Starts the trajectory of a goal. Throws as Trajectories::begin does; then all goals go on.
  void begin(const engine::World& world, Id id, const TrajectoryGoal& goal);
  /// Ends the goal `id`, if it is on its way, and stops its joints.
  void cancel(const engine::World& world, Id id);
  /// Ends all goals with one of the joints, which `by` has taken.
  void replace(const std::vector<std::string>& joints, const std::string& by);
  /// Ends all goals; `by` names the cause.
  void end(const std::string& by);
  /// Compares the joints with their trajectories; call after each tick.
  void stepped(const engine::World& world);
  /// Ends goals whose joints are gone; call after edits.
  void edited(const engine::World& world);

  bool empty() const { return goals_.empty() && ended_.empty(); }
  std::vector<Progress> progress(const engine::World& world) const;
  /// Returns the goals that have ended since the last call.
  std::vector<End> take_ended();

 private:
  struct Joint {
    std::string name;
    engine::JointId id;
    TimedSpline course;
    JointTolerance path, goal;
  };
  struct Goal {
    Id id;
    double goal_time;
    std::vector<Joint> joints;
    bool is_over(double time) const;
  };

  bool check_present(const engine::World& world, const Goal& goal);
  bool goes_on(const engine::World& world, const Goal& goal);
  void finish(const engine::World& world, const Goal& goal, Cause cause, const std::string& why);

  Trajectories& trajectories_;
  std::vector<Goal> goals_;
  std::vector<End> ended_;
};

}  // namespace constraint_sim
