#include "ros/commands.h"

#include <geometry_msgs/Twist.h>
#include <geometry_msgs/WrenchStamped.h>
#include <std_msgs/Float64.h>
#include <trajectory_msgs/JointTrajectory.h>

#include "ros/guarded.h"
#include "ros/topic_names.h"

namespace constraint_sim {
namespace {

constexpr double kFeedbackPeriod = 0.05;  // period of feedback of actions, as in ros_control [s]

}  // namespace

Commands::Commands(Stepper& stepper, EditLog& edit_log, const Parameters& parameters,
                   const Robots& robots, TrajectoryActions& actions, ros::NodeHandle handle)
    : stepper_(stepper), edit_log_(edit_log), actions_(actions), changes_(parameters, robots) {
  actions_.start(
      {[this](auto id, const auto& goal) { begin(id, goal); }, [this](auto id) { cancel(id); }});
  listen<trajectory_msgs::JointTrajectory>(handle, "joint_trajectory", 10,
                                           [this](const trajectory_msgs::JointTrajectory& message) {
                                             return changes_.by_trajectory(message);
                                           });
  for (const std::string& name : names_in(parameters.command))
    listen<std_msgs::Float64>(handle, topic_of("command", name), 100,
                              [this, name](const std_msgs::Float64& message) {
                                return changes_.by_command(name, message.data);
                              });
  for (const std::string& name : names_in(parameters.cmd_vel))
    listen<geometry_msgs::Twist>(handle, topic_of("cmd_vel", name), 100,
                                 [this, name](const geometry_msgs::Twist& message) {
                                   return changes_.by_twist(name, message);
                                 });
  for (const std::string& name : names_in(parameters.wrench))
    listen<geometry_msgs::WrenchStamped>(handle, topic_of("wrench", name), 100,
                                         [this, name](const geometry_msgs::WrenchStamped& message) {
                                           return changes_.by_wrench(name, message);
                                         });
}

Commands::~Commands() { actions_.stop(); }

// ---- stepping thread

void Commands::stepped(const World& world, const ros::Time& stamp) {
  TrajectoryGoals& goals = *changes_.goals();
  goals.stepped(world);
  finish_goals();
  const double now = ros::SteadyTime::now().toSec();
  if (now < next_feedback_ || !actions_.anybody_listens_to_feedback()) return;
  next_feedback_ = now + kFeedbackPeriod;
  for (const TrajectoryGoals::Progress& progress : goals.progress(world))
    actions_.show(progress, stamp);
}

void Commands::edited(const World& world) {
  changes_.goals()->edited(world);
  finish_goals();
}

void Commands::end(const std::string& by) {
  changes_.end(by);
  finish_goals();
}

void Commands::finish_goals() {
  for (const TrajectoryGoals::End& end : changes_.goals()->take_ended()) actions_.finish(end);
}

// ---- subscriber threads

void Commands::begin(TrajectoryActions::Id id, const TrajectoryGoal& goal) {
  stepper_.post([this, id, change = changes_.by_goal(id, goal)](World& world) {
    edit_log_.record_driven(stepper_, &world, [&](Driver* driver) {
      try {
        change(driver);
        actions_.accept(id);
      } catch (...) {
        actions_.reject(id);
      }
    });
  });
}

void Commands::cancel(TrajectoryActions::Id id) {
  stepper_.post([this, change = changes_.by_cancel(id)](World& world) {
    edit_log_.record_driven(stepper_, &world, [&](Driver* driver) { change(driver); });
  });
}

template <class Message, class ChangeBy>
void Commands::listen(ros::NodeHandle& handle, const std::string& topic, std::uint32_t queue,
                      ChangeBy change_by) {
  const SharedGuard guard = make_guard(topic);
  subscribers_.push_back(guarded_subscribe<Message>(
      handle, guard, queue, [this, guard, change_by](const Message& message) {
        const CommandChanges::Change change = change_by(message);
        guarded_post(stepper_, guard, [this, guard, change](World& world) {
          edit_log_.record_driven(stepper_, &world,
                                  [&](Driver* driver) { (*guard)([&] { change(driver); }); });
        });
      }));
}

}  // namespace constraint_sim
