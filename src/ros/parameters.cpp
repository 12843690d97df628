#include "ros/parameters.h"

#include <ros/package.h>
#include <ros/param.h>

#include <cmath>
#include <fstream>
#include <stdexcept>

#include "constraint_sim/scene.h"

namespace constraint_sim {
namespace {

[[noreturn]] void refuse(const std::string& name, const std::string& why) {
  throw std::invalid_argument("parameter ~" + name + ": " + why);
}

template <class T>
void read(const ros::NodeHandle& handle, const std::string& name, const char* type, T& value) {
  XmlRpc::XmlRpcValue found;
  if (handle.getParam(name, found) && !handle.getParam(name, value))
    refuse(name, std::string("must be a ") + type + ", got " + found.toXml());
  handle.setParam(name, value);
}

void check_positive(const std::string& name, double value) {
  if (!std::isfinite(value) || value <= 0.0)
    refuse(name, "must be a number > 0, got " + std::to_string(value));
}

std::string file_of_scene(const std::string& name) {
  const std::string scheme = "package://";
  if (name.compare(0, scheme.size(), scheme) == 0) {
    const std::string rest = name.substr(scheme.size());
    const std::string package = rest.substr(0, rest.find('/'));
    const std::string folder = ros::package::getPath(package);
    if (folder.empty())
      throw std::invalid_argument("scene: there is no package '" + package + "' in '" + name + "'");
    return folder + rest.substr(package.size());
  }
  const std::string shipped =
      ros::package::getPath("constraint_sim") + "/config/scenes/" + name + ".yaml";
  const bool is_shipped = name.find('/') == std::string::npos && std::ifstream(shipped).good();
  return is_shipped ? shipped : name;
}

}  // namespace

Parameters read_parameters(const ros::NodeHandle& private_handle) {
  Parameters p;
  ros::param::get("/use_sim_time", p.use_sim_time);
  read(private_handle, "scene", "string", p.scene);
  read(private_handle, "time_step", "number", p.time_step);
  read(private_handle, "real_time_factor", "number", p.real_time_factor);
  read(private_handle, "publish_rate", "number", p.publish_rate);
  read(private_handle, "publish_tf", "truth value", p.publish_tf);
  read(private_handle, "publish_clock", "truth value", p.publish_clock);
  read(private_handle, "paused", "truth value", p.paused);
  read(private_handle, "world_frame", "string", p.world_frame);
  read(private_handle, "frame_prefix", "string", p.frame_prefix);
  read(private_handle, "closing_time", "number", p.closing_time);
  check_positive("time_step", p.time_step);
  check_positive("publish_rate", p.publish_rate);
  check_positive("closing_time", p.closing_time);
  if (!std::isfinite(p.real_time_factor) || p.real_time_factor < 0.0)
    refuse("real_time_factor", "must be >= 0, got " + std::to_string(p.real_time_factor));
  if (p.world_frame.empty() || p.world_frame.front() == '/')
    refuse("world_frame", "must be a frame without a leading slash, got '" + p.world_frame + "'");
  if (!p.frame_prefix.empty() && p.frame_prefix.front() == '/')
    refuse("frame_prefix", "must not begin with a slash, got '" + p.frame_prefix + "'");
  return p;
}

engine::World load_world(const std::string& name, const std::string& text,
                         const Parameters& parameters) {
  engine::WorldOptions defaults;
  defaults.time_step = parameters.time_step;
  defaults.closing_time = parameters.closing_time;
  if (!text.empty()) return engine::load_scene(text, "text", defaults);
  if (!name.empty()) return engine::load_scene_file(file_of_scene(name), defaults);
  return engine::World(defaults);
}

}  // namespace constraint_sim
