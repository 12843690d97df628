#include "sim/trajectory_goals.h"

#include <algorithm>
#include <cmath>
#include <sstream>
#include <utility>

namespace constraint_sim {
namespace {

std::string joint_text(const std::string& name) { return "joint '" + name + "'"; }

bool has_same_joint(const engine::World& world, const std::string& name, engine::JointId id) {
  return world.has_joint(name) && world.find_joint(name) == id;
}

/// Returns which tolerance a deviation exceeds; empty: none.
std::string excess_text(const JointTolerance& deviation, const JointTolerance& tolerance) {
  std::ostringstream text;
  const auto compare = [&](const char* what, double value, double most) {
    if (text.tellp() == 0 && most > 0.0 && !(std::abs(value) <= most))
      text << what << " off by " << std::abs(value) << ", tolerance " << most;
  };
  compare("position", deviation.position, tolerance.position);
  compare("velocity", deviation.velocity, tolerance.velocity);
  return text.str();
}

}  // namespace

bool TrajectoryGoals::Goal::is_over(double time) const {
  return std::all_of(joints.begin(), joints.end(),
                     [&](const Joint& joint) { return time >= joint.course.end_time(); });
}

void TrajectoryGoals::begin(const engine::World& world, Id id, const TrajectoryGoal& goal) {
  const std::vector<std::string>& names = goal.trajectory.joints;
  trajectories_.begin(world, goal.trajectory);
  replace(names, "another goal");
  Goal next{id, goal.goal_time, {}};
  for (std::size_t k = 0; k < names.size(); ++k) {
    const engine::JointId joint = world.find_joint(names[k]);
    next.joints.push_back(
        {names[k], joint, *trajectories_.course(joint), goal.path[k], goal.goal[k]});
  }
  goals_.push_back(std::move(next));
}

void TrajectoryGoals::cancel(const engine::World& world, Id id) {
  const auto found =
      std::find_if(goals_.begin(), goals_.end(), [&](const Goal& goal) { return goal.id == id; });
  if (found == goals_.end()) return;
  finish(world, *found, Cause::kReplaced, "cancelled; its joints stop");
  goals_.erase(found);
}

void TrajectoryGoals::replace(const std::vector<std::string>& joints, const std::string& by) {
  const auto is_taken = [&](const Goal& goal) {
    for (const Joint& joint : goal.joints)
      if (std::find(joints.begin(), joints.end(), joint.name) != joints.end()) {
        ended_.push_back({goal.id, Cause::kReplaced, by + " takes " + joint_text(joint.name)});
        return true;
      }
    return false;
  };
  goals_.erase(std::remove_if(goals_.begin(), goals_.end(), is_taken), goals_.end());
}

void TrajectoryGoals::end(const std::string& by) {
  for (const Goal& goal : std::exchange(goals_, {}))
    ended_.push_back({goal.id, Cause::kReplaced, "ended by " + by});
}

void TrajectoryGoals::stepped(const engine::World& world) {
  goals_.erase(std::remove_if(goals_.begin(), goals_.end(),
                              [&](const Goal& goal) { return !goes_on(world, goal); }),
               goals_.end());
}

void TrajectoryGoals::edited(const engine::World& world) {
  goals_.erase(std::remove_if(goals_.begin(), goals_.end(),
                              [&](const Goal& goal) { return !check_present(world, goal); }),
               goals_.end());
}

bool TrajectoryGoals::check_present(const engine::World& world, const Goal& goal) {
  for (const Joint& joint : goal.joints) {
    if (has_same_joint(world, joint.name, joint.id)) continue;
    finish(world, goal, Cause::kLost, joint_text(joint.name) + " is gone");
    return false;
  }
  return true;
}

// Ends the goal where a joint is lost, beyond a tolerance of the path, or where the time is over.
bool TrajectoryGoals::goes_on(const engine::World& world, const Goal& goal) {
  if (!check_present(world, goal)) return false;
  const double time = world.time();
  const bool is_over = goal.is_over(time);
  std::string open;  // first joint that is not within its tolerance at the end
  for (const Joint& joint : goal.joints) {
    if (!is_over && !trajectories_.drives(joint.id)) {
      finish(world, goal, Cause::kLost, joint_text(joint.name) + " has left its trajectory");
      return false;
    }
    const engine::CoordinateState& now = world.joint_state(joint.id).coordinates[0];
    const JointTolerance deviation{now.position - joint.course.at(time),
                                   now.velocity - joint.course.rate(time)};
    const std::string excess = excess_text(deviation, is_over ? joint.goal : joint.path);
    if (excess.empty()) continue;
    const std::string why = joint_text(joint.name) + ": " + excess;
    if (!is_over) {
      finish(world, goal, Cause::kPathViolated, why);
      return false;
    }
    if (open.empty()) open = why;
  }
  if (!is_over) return true;
  if (open.empty()) {
    finish(world, goal, Cause::kReached, "");
    return false;
  }
  const bool is_late = time > goal.joints[0].course.end_time() + goal.goal_time;
  if (is_late) finish(world, goal, Cause::kGoalViolated, open);
  return !is_late;
}

// Stops the joints that are still on their way, since no goal is responsible for them any more.
void TrajectoryGoals::finish(const engine::World& world, const Goal& goal, Cause cause,
                             const std::string& why) {
  ended_.push_back({goal.id, cause, why});
  JointTrajectory stop;
  for (const Joint& joint : goal.joints)
    if (world.time() < joint.course.end_time() && trajectories_.drives(joint.id) &&
        has_same_joint(world, joint.name, joint.id) &&
        world.joint(joint.id).coordinates[0].motor.has_value())
      stop.joints.push_back(joint.name);
  if (!stop.joints.empty()) trajectories_.begin(world, stop);
}

std::vector<TrajectoryGoals::Progress> TrajectoryGoals::progress(const engine::World& world) const {
  std::vector<Progress> all;
  for (const Goal& goal : goals_) {
    Progress& progress =
        all.emplace_back(Progress{goal.id, world.time() - goal.joints[0].course.start, {}});
    for (const Joint& joint : goal.joints) {
      if (!has_same_joint(world, joint.name, joint.id)) continue;
      const engine::CoordinateState& now = world.joint_state(joint.id).coordinates[0];
      progress.joints.push_back({joint.name, joint.course.at(world.time()),
                                 joint.course.rate(world.time()), now.position, now.velocity});
    }
  }
  return all;
}

std::vector<TrajectoryGoals::End> TrajectoryGoals::take_ended() {
  return std::exchange(ended_, {});
}

}  // namespace constraint_sim
