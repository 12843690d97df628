#include "ros/commands.h"

#include <geometry_msgs/Twist.h>
#include <geometry_msgs/WrenchStamped.h>
#include <std_msgs/Float64.h>
#include <trajectory_msgs/JointTrajectory.h>

#include "ros/guarded.h"
#include "ros/topic_names.h"

namespace constraint_sim {

Commands::Commands(Stepper& stepper, EditLog& edit_log, const Parameters& parameters,
                   const Robots& robots, ros::NodeHandle handle)
    : stepper_(stepper), edit_log_(edit_log), changes_(parameters, robots) {
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
