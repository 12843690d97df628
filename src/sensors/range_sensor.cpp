// Range sensors on bodies, such as ultrasonic and infrared ones. The manual is docs/sensors.md.

#include <sensor_msgs/Range.h>

#include <algorithm>
#include <pluginlib/class_list_macros.hpp>

#include "sensors/rangefinder.h"
#include "sensors/sensors.h"

namespace constraint_sim::sensors {
namespace {

/// The least distance along beams within a cone about the x axis of the sensor.
class RangeSensor {
 public:
  static constexpr const char* kFolder = "range";

  RangeSensor(const ros::NodeHandle& range, const std::string& name)
      : name_(name),
        beams_(ros::NodeHandle(range, name)),
        field_of_view_(
            number_between(ros::NodeHandle(range, name), "field_of_view", 0.0, 0.0, kPi)) {
    const ros::NodeHandle handle(range, name);
    const std::size_t samples =
        count_between(handle, "samples", field_of_view_ > 0.0 ? 64 : 1, 1, 10000);
    // The first beam is the axis, the last is on the rim; between them a spiral by the golden angle
    // covers the cone evenly (Vogel 1979).
    constexpr double kGoldenAngle = 2.399963229728653;
    for (std::size_t i = 0; i < samples; ++i) {
      const double share =
          i == 0 ? 0.0 : std::sqrt(static_cast<double>(i) / static_cast<double>(samples - 1));
      const double off = 0.5 * field_of_view_ * share,
                   around = kGoldenAngle * static_cast<double>(i);
      directions_.emplace_back(std::cos(off), std::sin(off) * std::cos(around),
                               std::sin(off) * std::sin(around));
    }
    const auto radiation = handle.param<std::string>("radiation", "infrared");
    if (radiation != "infrared" && radiation != "ultrasound")
      throw std::invalid_argument(handle.getNamespace() +
                                  "/radiation: must be infrared or ultrasound, got '" + radiation +
                                  "'");
    radiation_ =
        radiation == "infrared" ? sensor_msgs::Range::INFRARED : sensor_msgs::Range::ULTRASOUND;
    ros::NodeHandle topics(range);
    topic_ = topics.advertise<sensor_msgs::Range>(name, 1000);
  }

  void stepped(const engine::World& world, const PluginHost& host) const {
    if (topic_.getNumSubscribers() == 0 || !beams_.is_due(world)) return;
    const std::vector<double> exact = beams_.exact(world, directions_);
    sensor_msgs::Range message;
    message.header.stamp = stamp_of(host);
    message.header.frame_id = name_;
    message.radiation_type = radiation_;
    message.field_of_view = static_cast<float>(field_of_view_);
    message.min_range = static_cast<float>(beams_.min());
    message.max_range = static_cast<float>(beams_.max());
    const double nearest = *std::min_element(exact.begin(), exact.end());
    message.range = static_cast<float>(beams_.noisy(world, nearest, 0));
    topic_.publish(message);
  }

 private:
  std::string name_;
  Rangefinder beams_;
  double field_of_view_;                     // whole angle of the cone [rad]
  std::vector<Eigen::Vector3d> directions_;  // in the sensor's frame
  std::uint8_t radiation_ = 0;
  ros::Publisher topic_;
};

using Range = Sensors<RangeSensor>;

}  // namespace
}  // namespace constraint_sim::sensors

PLUGINLIB_EXPORT_CLASS(constraint_sim::sensors::Range, constraint_sim::Plugin)
