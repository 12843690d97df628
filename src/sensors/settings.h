#pragma once

#include <ros/node_handle.h>
#include <ros/time.h>

#include <Eigen/Geometry>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <sstream>
#include <stdexcept>
#include <string>
#include <vector>

#include "constraint_sim/plugin.h"

namespace constraint_sim::sensors {

/// Body and pose of a sensor, from the parameters `body`, `position` and `orientation`.
struct Mount {
  std::string body;
  Eigen::Vector3d position = Eigen::Vector3d::Zero();  ///< in the body's frame [m]
  Eigen::Quaterniond orientation = Eigen::Quaterniond::Identity();
};

/// Names in a parameter, with spaces between; none where it is left out.
inline std::vector<std::string> names_of(const ros::NodeHandle& handle, const std::string& name) {
  std::istringstream text(handle.param<std::string>(name, ""));
  std::vector<std::string> names;
  for (std::string word; text >> word;) names.push_back(word);
  return names;
}

/// Names of sensors in the parameter `sensors`.
inline std::vector<std::string> sensor_names(const ros::NodeHandle& handle) {
  std::vector<std::string> names = names_of(handle, "sensors");
  if (names.empty()) throw std::invalid_argument(handle.getNamespace() + "/sensors: names none");
  return names;
}

/// Returns a parameter that must be a number.
inline double number_of(const ros::NodeHandle& handle, const std::string& name, double fallback) {
  double value = fallback;
  if (handle.hasParam(name) && !handle.getParam(name, value))
    throw std::invalid_argument(handle.getNamespace() + "/" + name + ": must be a number");
  return value;
}

/// Returns a parameter that must be a number ≥ 0.
inline double not_negative(const ros::NodeHandle& handle, const std::string& name,
                           double fallback) {
  const double value = number_of(handle, name, fallback);
  if (!(value >= 0.0 && value < 1e20))
    throw std::invalid_argument(handle.getNamespace() + "/" + name + ": must be a number >= 0");
  return value;
}

/// Throws the error of a number that is out of range.
[[noreturn]] inline void refuse_number(const ros::NodeHandle& handle, const std::string& name,
                                       const char* kind, double least, double most, double got) {
  std::ostringstream why;
  why << handle.getNamespace() << "/" << name << ": must be a " << kind << " from " << least
      << " to " << most << ", got " << got;
  throw std::invalid_argument(why.str());
}

/// Returns a parameter that must be a number within two bounds.
inline double number_between(const ros::NodeHandle& handle, const std::string& name,
                             double fallback, double least, double most) {
  const double value = number_of(handle, name, fallback);
  if (!(value >= least && value <= most)) refuse_number(handle, name, "number", least, most, value);
  return value;
}

/// Returns a parameter that must be a whole number within two bounds.
inline std::size_t count_between(const ros::NodeHandle& handle, const std::string& name,
                                 double fallback, double least, double most) {
  const double value = number_of(handle, name, fallback);
  if (!(value >= least && value <= most) || value != std::floor(value))
    refuse_number(handle, name, "whole number", least, most, value);
  return static_cast<std::size_t>(value);
}

/// Returns the numbers of a parameter: a list, or the text of one, as a command line has it.
inline std::vector<double> numbers(const ros::NodeHandle& handle, const std::string& name,
                                   const std::vector<double>& fallback) {
  std::vector<double> list;
  if (!handle.hasParam(name)) return fallback;
  if (handle.getParam(name, list) && list.size() == fallback.size()) return list;
  std::string text;
  handle.getParam(name, text);
  for (char& c : text)
    if (c == '[' || c == ']' || c == ',') c = ' ';
  std::istringstream words(text);
  for (double number = 0.0; words >> number;) list.push_back(number);
  if (list.size() != fallback.size() || !words.eof())
    throw std::invalid_argument(handle.getNamespace() + "/" + name + ": must be a list of " +
                                std::to_string(fallback.size()) + " numbers");
  return list;
}

inline Mount mount_of(const ros::NodeHandle& handle) {
  Mount mount;
  if (!handle.getParam("body", mount.body))
    throw std::invalid_argument(handle.getNamespace() + "/body: is left out");
  const auto p = numbers(handle, "position", {0.0, 0.0, 0.0});
  const auto q = numbers(handle, "orientation", {0.0, 0.0, 0.0, 1.0});
  mount.position = {p[0], p[1], p[2]};
  mount.orientation = Eigen::Quaterniond(q[3], q[0], q[1], q[2]);
  if (!(mount.orientation.norm() > 0.5) || !mount.position.allFinite())
    throw std::invalid_argument(handle.getNamespace() + ": position or orientation is not finite");
  mount.orientation.normalize();
  return mount;
}

inline ros::Time stamp_of(const PluginHost& host) {
  ros::Time stamp;
  return stamp.fromNSec(static_cast<std::uint64_t>(host.stamp()));
}

/// Orientation of a sensor, and velocities of its origin, in world axes.
struct Motion {
  Eigen::Quaterniond orientation;
  Eigen::Vector3d velocity, angular_velocity;
};
inline Motion motion_of(const engine::BodyState& body, const Mount& mount) {
  const Eigen::Vector3d arm = body.orientation * mount.position;
  return {body.orientation * mount.orientation,
          body.linear_velocity + body.angular_velocity.cross(arm), body.angular_velocity};
}

}  // namespace constraint_sim::sensors
