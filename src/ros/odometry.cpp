#include "ros/odometry.h"

#include <nav_msgs/Odometry.h>

#include <algorithm>
#include <optional>

#include "ros/conversions.h"
#include "ros/topic_names.h"

namespace constraint_sim {
namespace {

// Returns the state of a frame that is fixed to a body.
engine::BodyState state_of(const engine::World& world, const RobotLink& link) {
  const engine::BodyState& body = world.state(link.body);
  const Eigen::Vector3d r = body.orientation * link.in_body.translation();
  engine::BodyState state = body;
  state.position += r;
  state.orientation = body.orientation * Eigen::Quaterniond(link.in_body.linear());
  state.linear_velocity += body.angular_velocity.cross(r);
  return state;
}

}  // namespace

Odometry::Odometry(const Parameters& parameters, const Robots& robots,
                   ros::NodeHandle& private_handle, const ros::SubscriberStatusCallback& welcome)
    : parameters_(parameters), robots_(robots) {
  for (const std::string& name : names_in(parameters.odometry))
    topics_[name] =
        private_handle.advertise<nav_msgs::Odometry>(topic_of("odometry", name), 100, welcome);
}

bool Odometry::anybody_listens() const {
  return std::any_of(topics_.begin(), topics_.end(),
                     [](const auto& topic) { return topic.second.getNumSubscribers() > 0; });
}

void Odometry::publish(const engine::World& world, const ros::Time& stamp) const {
  for (const auto& [name, topic] : topics_) {
    if (topic.getNumSubscribers() == 0) continue;
    std::optional<RobotLink> frame = robots_.find_link(world, name);
    if (!frame && world.has_body(name))
      frame = RobotLink{name, world.find_body(name), Eigen::Isometry3d::Identity()};
    if (!frame) continue;  // missing, so far or by now
    const engine::BodyState state = state_of(world, *frame);
    const Eigen::Quaterniond to_own = state.orientation.conjugate();
    nav_msgs::Odometry message;
    message.header.stamp = stamp;
    message.header.frame_id = parameters_.world_frame;
    message.child_frame_id = parameters_.frame_prefix + name;
    message.pose.pose = to_pose(state);
    message.twist.twist.linear = to_vector(to_own * state.linear_velocity);
    message.twist.twist.angular = to_vector(to_own * state.angular_velocity);
    topic.publish(message);
  }
}

}  // namespace constraint_sim
