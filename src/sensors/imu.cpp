// Inertial measurement units on bodies. The manual is docs/sensors.md.

#include <sensor_msgs/Imu.h>

#include <cstdint>
#include <optional>
#include <pluginlib/class_list_macros.hpp>

#include "sensors/noise.h"
#include "sensors/sensors.h"

namespace constraint_sim::sensors {
namespace {

/// White noise of a triad: deviation √(density² rate) of a sample, and a constant bias.
struct Triad {
  double density = 0.0;  ///< [unit/√Hz]
  Eigen::Vector3d bias = Eigen::Vector3d::Zero();
};

class ImuSensor {
 public:
  static constexpr const char* kFolder = "imu";

  ImuSensor(const ros::NodeHandle& imu, const std::string& name)
      : handle_(imu, name),
        name_(name),
        mount_(mount_of(handle_)),
        period_(1.0 / not_negative(handle_, "rate", 1e9)),
        noise_(static_cast<std::uint64_t>(handle_.param("seed", 0))),
        gyroscope_(triad("gyroscope", 0)),
        accelerometer_(triad("accelerometer", 3)) {
    ros::NodeHandle topics(imu);
    topic_ = topics.advertise<sensor_msgs::Imu>(name, 1000);
  }

  void stepped(const engine::World& world, const PluginHost& host) {
    if (!world.has_body(mount_.body)) return last_.reset();
    const Sample now{world.time(), world.step_count(),
                     motion_of(world.state(world.find_body(mount_.body)), mount_)};
    // The clock went back, or a step is missing: another world.
    if (!last_ || now.step <= last_->step || now.step > last_step_ + 1) last_ = now;
    last_step_ = now.step;
    const double passed = now.time - last_->time;
    if (passed <= 0.0 || passed < period_ * (1.0 - 1e-9)) return;
    if (topic_.getNumSubscribers() > 0)
      topic_.publish(message(now, passed, world.options().gravity, host));
    last_ = now;
  }

 private:
  struct Sample {
    double time;  // simulated [s]
    std::uint64_t step;
    Motion motion;
  };

  Triad triad(const std::string& name, std::uint64_t channel) const {
    constexpr std::uint64_t kTurnOn = ~std::uint64_t{0};
    return {not_negative(handle_, name + "_noise", 0.0),
            not_negative(handle_, name + "_bias", 0.0) * noise_.vector(kTurnOn, channel)};
  }

  // The specific force is the mean over the time since the last message, as that of a sensor that
  // integrates: the change of velocity of the sensor's point without that by gravity.
  sensor_msgs::Imu message(const Sample& now, double passed, const Eigen::Vector3d& gravity,
                           const PluginHost& host) const {
    const Eigen::Quaterniond to_sensor = now.motion.orientation.conjugate();
    const Eigen::Vector3d force = (now.motion.velocity - last_->motion.velocity) / passed - gravity;
    sensor_msgs::Imu message;
    message.header.stamp = stamp_of(host);
    message.header.frame_id = name_;
    message.orientation.x = now.motion.orientation.x();
    message.orientation.y = now.motion.orientation.y();
    message.orientation.z = now.motion.orientation.z();
    message.orientation.w = now.motion.orientation.w();
    const auto set = [&](const Eigen::Vector3d& exact, const Triad& triad, std::uint64_t channel,
                         geometry_msgs::Vector3* value, boost::array<double, 9>* covariance) {
      const double deviation = triad.density / std::sqrt(passed);
      const Eigen::Vector3d read =
          exact + triad.bias + deviation * noise_.vector(now.step, channel);
      value->x = read.x();
      value->y = read.y();
      value->z = read.z();
      for (const std::size_t i : {0, 4, 8}) (*covariance)[i] = deviation * deviation;
    };
    set(to_sensor * now.motion.angular_velocity, gyroscope_, 0, &message.angular_velocity,
        &message.angular_velocity_covariance);
    set(to_sensor * force, accelerometer_, 3, &message.linear_acceleration,
        &message.linear_acceleration_covariance);
    return message;
  }

  ros::NodeHandle handle_;
  std::string name_;
  Mount mount_;
  double period_;  // [s]
  Noise noise_;
  Triad gyroscope_, accelerometer_;
  ros::Publisher topic_;
  std::optional<Sample> last_;  // at the last message
  std::uint64_t last_step_ = 0;
};

using Imu = Sensors<ImuSensor>;

}  // namespace
}  // namespace constraint_sim::sensors

PLUGINLIB_EXPORT_CLASS(constraint_sim::sensors::Imu, constraint_sim::Plugin)
