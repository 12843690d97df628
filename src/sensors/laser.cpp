// Planar laser scanners on bodies. The manual is docs/sensors.md.

#include <sensor_msgs/LaserScan.h>

#include <pluginlib/class_list_macros.hpp>

#include "sensors/rangefinder.h"
#include "sensors/sensors.h"

namespace constraint_sim::sensors {
namespace {

/// Beams in the x-y plane of the sensor, at equal angles about z from angle 0 along x. All beams of
/// a scan are of one moment, the end of the step.
class LaserSensor {
 public:
  static constexpr const char* kFolder = "laser";

  LaserSensor(const ros::NodeHandle& laser, const std::string& name)
      : name_(name),
        beams_(ros::NodeHandle(laser, name)),
        angle_min_(angle(laser, "angle_min", -0.5 * kPi)),
        angle_max_(angle(laser, "angle_max", 0.5 * kPi)) {
    const ros::NodeHandle handle(laser, name);
    const std::size_t samples = count_between(handle, "samples", 181, 2, 10000);
    if (!(angle_min_ < angle_max_))
      throw std::invalid_argument(handle.getNamespace() + "/angle_max: must exceed angle_min");
    increment_ = (angle_max_ - angle_min_) / static_cast<double>(samples - 1);
    for (std::size_t i = 0; i < samples; ++i) {
      const double angle = angle_min_ + static_cast<double>(i) * increment_;
      directions_.emplace_back(std::cos(angle), std::sin(angle), 0.0);
    }
    ros::NodeHandle topics(laser);
    topic_ = topics.advertise<sensor_msgs::LaserScan>(name, 1000);
  }

  void stepped(const engine::World& world, const PluginHost& host) const {
    if (topic_.getNumSubscribers() == 0 || !beams_.is_due(world)) return;
    sensor_msgs::LaserScan message;
    message.header.stamp = stamp_of(host);
    message.header.frame_id = name_;
    message.angle_min = static_cast<float>(angle_min_);
    message.angle_max = static_cast<float>(angle_max_);
    message.angle_increment = static_cast<float>(increment_);
    message.scan_time = static_cast<float>(beams_.period(world));
    message.range_min = static_cast<float>(beams_.min());
    message.range_max = static_cast<float>(beams_.max());
    const std::vector<double> exact = beams_.exact(world, directions_);
    message.ranges.reserve(exact.size());
    for (std::size_t i = 0; i < exact.size(); ++i)
      message.ranges.push_back(static_cast<float>(beams_.noisy(world, exact[i], i)));
    topic_.publish(message);
  }

 private:
  double angle(const ros::NodeHandle& laser, const char* which, double fallback) const {
    return number_between(ros::NodeHandle(laser, name_), which, fallback, -2.0 * kPi, 2.0 * kPi);
  }

  std::string name_;
  Rangefinder beams_;
  double angle_min_, angle_max_, increment_ = 0.0;  // [rad]
  std::vector<Eigen::Vector3d> directions_;         // in the sensor's frame
  ros::Publisher topic_;
};

using Laser = Sensors<LaserSensor>;

}  // namespace
}  // namespace constraint_sim::sensors

PLUGINLIB_EXPORT_CLASS(constraint_sim::sensors::Laser, constraint_sim::Plugin)
