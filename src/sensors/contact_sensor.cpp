// Contact sensors on bodies. The manual is docs/sensors.md.

#include <geometry_msgs/WrenchStamped.h>

#include <pluginlib/class_list_macros.hpp>

#include "sensors/sensors.h"

namespace constraint_sim::sensors {
namespace {

/// Force and torque of all contacts of a body, mean over the step, at the sensor's origin and along
/// its axes. With a `partner` the contacts with this other body alone count.
class ContactSensor {
 public:
  static constexpr const char* kFolder = "contact";

  ContactSensor(const ros::NodeHandle& contact, const std::string& name)
      : name_(name),
        mount_(mount_of(ros::NodeHandle(contact, name))),
        partner_(ros::NodeHandle(contact, name).param<std::string>("partner", "")) {
    ros::NodeHandle topics(contact);
    topic_ = topics.advertise<geometry_msgs::WrenchStamped>(name, 1000);
  }

  void stepped(const engine::World& world, const PluginHost& host) const {
    if (topic_.getNumSubscribers() == 0 || !world.has_body(mount_.body)) return;
    const engine::BodyId body = world.find_body(mount_.body);
    const engine::BodyState& state = world.state(body);
    const Eigen::Vector3d origin = state.position + state.orientation * mount_.position;
    Eigen::Vector3d force = Eigen::Vector3d::Zero(), torque = Eigen::Vector3d::Zero();
    for (const engine::Contact& contact : world.contacts()) {
      const bool is_a = contact.body_a == body;
      if (!is_a && contact.body_b != body) continue;
      const engine::BodyId other = is_a ? contact.body_b : contact.body_a;
      if (!partner_.empty() && world.body(other).name != partner_) continue;
      const Eigen::Vector3d on_body = is_a ? contact.force : Eigen::Vector3d(-contact.force);
      force += on_body;
      torque += (contact.position - origin).cross(on_body);
    }
    const Eigen::Quaterniond to_sensor = (state.orientation * mount_.orientation).conjugate();
    const auto set = [&](const Eigen::Vector3d& value, geometry_msgs::Vector3* message) {
      const Eigen::Vector3d read = to_sensor * value;
      message->x = read.x();
      message->y = read.y();
      message->z = read.z();
    };
    geometry_msgs::WrenchStamped message;
    message.header.stamp = stamp_of(host);
    message.header.frame_id = name_;
    set(force, &message.wrench.force);
    set(torque, &message.wrench.torque);
    topic_.publish(message);
  }

 private:
  std::string name_;
  Mount mount_;
  std::string partner_;
  ros::Publisher topic_;
};

using Contact = Sensors<ContactSensor>;

}  // namespace
}  // namespace constraint_sim::sensors

PLUGINLIB_EXPORT_CLASS(constraint_sim::sensors::Contact, constraint_sim::Plugin)
