#include "ros/wrench_topics.h"

#include <geometry_msgs/WrenchStamped.h>
#include <ros/console.h>

#include <algorithm>
#include <utility>

#include "ros/conversions.h"
#include "ros/topic_names.h"
#include "sim/grip.h"

namespace constraint_sim {
namespace {

constexpr const char* kForceTorque = "force_torque";

geometry_msgs::WrenchStamped to_msg(const engine::World::JointWrench& wrench) {
  geometry_msgs::WrenchStamped message;
  message.wrench.force = to_vector(wrench.force);
  message.wrench.torque = to_vector(wrench.torque);
  return message;
}

// Returns the joint's frame on B at its anchor; for kinds without axes, the axes of B.
geometry_msgs::Transform frame_of(const engine::Joint& joint) {
  engine::BodyState frame;
  frame.position = joint.anchor_b;
  if (engine::info(joint.kind).has_frames) frame.orientation = *joint.frame_b;
  return to_transform(frame);
}

}  // namespace

WrenchTopics::WrenchTopics(const Parameters& parameters, const ros::NodeHandle& private_handle,
                           ros::SubscriberStatusCallback welcome)
    : parameters_(parameters), private_handle_(private_handle), welcome_(std::move(welcome)) {}

void WrenchTopics::update(const engine::World& world) {
  Topics next;
  std::set<std::string> taken;
  std::size_t count = 0;
  for (const engine::JointId id : world.joint_ids()) {
    const engine::Joint& joint = world.joint(id);
    if (engine::info(joint.kind).couples_joints)
      continue;                    // acts along coordinates of other joints
    if (is_grip(joint)) continue;  // exists only while a mouse button is pressed
    const std::string& name = joint.name;
    if (++count > kMost) {
      if (without_.insert("").second)
        ROS_INFO("force_torque: the first %zu constraints have a topic, %zu have none", kMost,
                 world.joint_ids().size() - kMost);
      break;
    }
    const bool is_first = taken.insert(topic_of(kForceTorque, name)).second;
    const auto known = topics_.find(name);
    ros::Publisher topic =
        is_first && known != topics_.end() ? known->second : advertise(name, is_first);
    if (!topic) continue;
    next.emplace(name, std::move(topic));
  }
  const std::lock_guard<std::mutex> lock(mutex_);
  std::swap(topics_, next);
}

// Advertises the topic of a constraint. Returns an empty publisher where ROS does not allow the
// name or the topic is taken.
ros::Publisher WrenchTopics::advertise(const std::string& constraint, bool is_free) {
  const std::string topic = topic_of(kForceTorque, constraint);
  std::string why;
  if (ros::names::validate(topic, why) && is_free)
    return private_handle_.advertise<geometry_msgs::WrenchStamped>(topic, 100, welcome_);
  if (without_.insert(constraint).second)
    ROS_WARN("constraint '%s' has no topic %s: %s", constraint.c_str(), topic.c_str(),
             why.empty() ? "another constraint has it" : why.c_str());
  return {};
}

bool WrenchTopics::anybody_listens() const {
  const std::lock_guard<std::mutex> lock(mutex_);
  return std::any_of(topics_.begin(), topics_.end(),
                     [](const auto& topic) { return topic.second.getNumSubscribers() > 0; });
}

std::vector<geometry_msgs::TransformStamped> WrenchTopics::publish(const engine::World& world,
                                                                   const ros::Time& stamp) const {
  std::vector<geometry_msgs::TransformStamped> frames;
  for (const auto& [constraint, topic] : topics_) {
    if (topic.getNumSubscribers() == 0 || !world.has_joint(constraint)) continue;
    const engine::JointId id = world.find_joint(constraint);
    const engine::Joint& joint = world.joint(id);
    geometry_msgs::TransformStamped& frame = frames.emplace_back();
    frame.header.stamp = stamp;
    frame.header.frame_id = joint.body_b == engine::kWorldBody
                                ? parameters_.world_frame
                                : parameters_.frame_prefix + world.body(joint.body_b).name;
    frame.child_frame_id = parameters_.frame_prefix + "force_torque/" + constraint;
    frame.transform = frame_of(joint);
    geometry_msgs::WrenchStamped message = to_msg(world.joint_wrench(id));
    message.header.stamp = stamp;
    message.header.frame_id = frame.child_frame_id;
    topic.publish(message);
  }
  return frames;
}

}  // namespace constraint_sim
