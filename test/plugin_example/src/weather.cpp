// Wind and a bowl for constraint_sim, and the reading of an anemometer on a body.

#include <constraint_sim/plugin.h>
#include <ros/ros.h>
#include <std_msgs/Float64.h>

#include <cmath>
#include <memory>
#include <pluginlib/class_list_macros.hpp>
#include <stdexcept>

namespace constraint_sim_plugin_example {

using constraint_sim::engine::CustomConstraint;
using constraint_sim::engine::CustomForce;
using constraint_sim::engine::CustomParameters;
using constraint_sim::engine::CustomWrench;
using constraint_sim::engine::FramePair;

double parameter(const CustomParameters& all, const std::string& name) {
  for (const auto& one : all)
    if (one.name == name) return one.value;
  throw std::invalid_argument("parameters: '" + name + "' is left out");
}

/// Drag −c (v − w) on B, with wind of speed w along x of A's axes, until the time `until`.
class Wind : public CustomForce {
 public:
  explicit Wind(const CustomParameters& p)
      : drag_(parameter(p, "drag")), speed_(parameter(p, "speed")) {
    if (drag_ < 0.0) throw std::invalid_argument("drag: must not be negative");
    for (const auto& one : p)
      if (one.name == "until") until_ = one.value;
  }
  CustomWrench wrench(double t, const FramePair& at, const FramePair& rates) const override {
    if (t > until_) throw std::runtime_error("the wind is over");
    return {-drag_ * (rates.d - speed_ * Eigen::Vector3d(at.axes_A.col(0))),
            Eigen::Vector3d::Zero()};
  }

 private:
  double drag_, speed_;      // [N s/m], [m/s]
  double until_ = INFINITY;  // [s]
};

/// Constraint z = ½ k (x² + y²) of B, in the axes of A.
class Bowl : public CustomConstraint {
 public:
  explicit Bowl(const CustomParameters& p) : k_(parameter(p, "k")) {}
  double value(const FramePair& at) const override {
    return at.d.z() - 0.5 * k_ * at.d.head<2>().squaredNorm();
  }
  FramePair gradient(const FramePair& at) const override {
    FramePair g;
    g.d << -k_ * at.d.head<2>(), 1.0;
    return g;
  }
  double gamma(const FramePair& /*at*/, const FramePair& rates) const override {
    return -k_ * rates.d.head<2>().squaredNorm();
  }

 private:
  double k_;  // [1/m]
};

/// Throws what is no std::exception, as code of others may, once time passes.
class Lightning : public CustomForce {
 public:
  CustomWrench wrench(double t, const FramePair& /*at*/,
                      const FramePair& /*rates*/) const override {
    if (t > 0.0) throw 1;
    return {Eigen::Vector3d::Zero(), Eigen::Vector3d::Zero()};
  }
};

class Weather : public constraint_sim::Plugin {
 public:
  void start(constraint_sim::PluginHost& host) override {
    host.add_force_type("weather/wind",
                        [](const CustomParameters& p) { return std::make_shared<Wind>(p); });
    host.add_constraint_type("weather/bowl",
                             [](const CustomParameters& p) { return std::make_shared<Bowl>(p); });
    host.add_force_type("weather/lightning",
                        [](const CustomParameters&) { return std::make_shared<Lightning>(); });
    ros::NodeHandle handle(host.private_namespace() + "/weather");
    handle.param<std::string>("anemometer", body_, "ball");
    handle.param("anemometer_breaks_at", breaks_at_, breaks_at_);
    speed_ = handle.advertise<std_msgs::Float64>("anemometer", 1000);
  }
  void stepped(const constraint_sim::engine::World& world) override {
    if (!world.has_body(body_)) return;
    if (world.time() > breaks_at_) throw 1;
    std_msgs::Float64 speed;
    speed.data = world.state(world.find_body(body_)).linear_velocity.norm();
    speed_.publish(speed);
  }

 private:
  std::string body_;
  double breaks_at_ = INFINITY;  // [s]
  ros::Publisher speed_;
};

}  // namespace constraint_sim_plugin_example

PLUGINLIB_EXPORT_CLASS(constraint_sim_plugin_example::Weather, constraint_sim::Plugin)
