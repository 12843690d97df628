#include "ros/robot_topics.h"

#include <algorithm>
#include <cstddef>
#include <set>
#include <utility>

namespace constraint_sim {
namespace {

std::string parameter_of(const std::string& robot) { return robot + "/robot_description"; }

// Returns the name of the joint that a coordinate belongs to: further coordinates are JOINT/INDEX.
std::string joint_of(const std::string& coordinate) {
  const std::size_t slash = coordinate.rfind('/');
  const bool has_index = slash != std::string::npos && slash + 2 == coordinate.size() &&
                         (coordinate.back() == '1' || coordinate.back() == '2');
  return has_index ? coordinate.substr(0, slash) : coordinate;
}

}  // namespace

RobotTopics::RobotTopics(const ros::NodeHandle& private_handle,
                         ros::SubscriberStatusCallback welcome)
    : handle_(private_handle, "robots"), welcome_(std::move(welcome)) {}

RobotTopics::~RobotTopics() {
  for (const auto& [name, topic] : topics_) handle_.deleteParam(name);
  if (!topics_.empty()) handle_.deleteParam("");
}

void RobotTopics::update(const std::vector<RobotDescription>& robots) {
  Topics next;
  for (const RobotDescription& robot : robots) {
    const auto known = topics_.find(robot.name);
    if (known != topics_.end() && known->second.robot.text == robot.text) {
      next.emplace(robot.name, known->second);
      continue;
    }
    handle_.setParam(parameter_of(robot.name), *robot.text);
    next.emplace(robot.name, Topic{handle_.advertise<sensor_msgs::JointState>(
                                       robot.name + "/joint_states", 100, welcome_),
                                   robot});
  }
  for (const auto& [name, topic] : topics_)
    if (next.count(name) == 0) handle_.deleteParam(name);
  if (next.empty() && !topics_.empty()) handle_.deleteParam("");  // the empty folder as well
  const std::lock_guard<std::mutex> lock(mutex_);
  std::swap(topics_, next);
}

bool RobotTopics::anybody_listens() const {
  const std::lock_guard<std::mutex> lock(mutex_);
  return std::any_of(topics_.begin(), topics_.end(), [](const auto& entry) {
    return entry.second.publisher.getNumSubscribers() > 0;
  });
}

void RobotTopics::add_fixed_joints(sensor_msgs::JointState* all) const {
  for (const auto& [name, topic] : topics_)
    for (const auto& [joint, position] : *topic.robot.fixed_joints) {
      all->name.push_back(joint);
      all->position.push_back(position);
      all->velocity.push_back(0.0);
      all->effort.push_back(0.0);
    }
}

void RobotTopics::publish(const sensor_msgs::JointState& all) const {
  for (const auto& [name, topic] : topics_) {
    if (topic.publisher.getNumSubscribers() == 0) continue;
    const std::set<std::string>& joints = *topic.robot.joints;
    sensor_msgs::JointState message;
    message.header = all.header;
    for (std::size_t i = 0; i < all.name.size(); ++i) {
      if (joints.count(all.name[i]) == 0 && joints.count(joint_of(all.name[i])) == 0) continue;
      message.name.push_back(all.name[i]);
      message.position.push_back(all.position[i]);
      message.velocity.push_back(all.velocity[i]);
      message.effort.push_back(all.effort[i]);
    }
    topic.publisher.publish(message);
  }
}

}  // namespace constraint_sim
