#include "ros/parameters.h"

#include <ros/names.h>
#include <ros/param.h>
#include <sys/stat.h>

#include <algorithm>
#include <cmath>
#include <cstdio>

#include "sim/words.h"

namespace constraint_sim {
namespace {

constexpr double kMostRealTimeFactor = 1e6;
constexpr double kMostPublishRate = 1e4;  // [Hz]

[[noreturn]] void refuse(const std::string& name, const std::string& why) {
  throw ParameterError(name, "parameter ~" + name + ": " + why);
}

const char* type_name(const std::string&) { return "string"; }
const char* type_name(double) { return "number"; }
const char* type_name(bool) { return "truth value"; }

std::string shown(const std::string& value) { return "'" + shortened(value, 200) + "'"; }
std::string shown(bool value) { return value ? "true" : "false"; }
std::string shown(double value) {
  char text[32];
  std::snprintf(text, sizeof text, "%g", value);
  return text;
}

/// Calls do_with(name, member pointer) for each private parameter.
template <class Do>
void for_each(Do do_with) {
  do_with("scene", &Parameters::scene);
  do_with("time_step", &Parameters::time_step);
  do_with("real_time_factor", &Parameters::real_time_factor);
  do_with("publish_rate", &Parameters::publish_rate);
  do_with("publish_tf", &Parameters::publish_tf);
  do_with("publish_clock", &Parameters::publish_clock);
  do_with("paused", &Parameters::paused);
  do_with("world_frame", &Parameters::world_frame);
  do_with("frame_prefix", &Parameters::frame_prefix);
  do_with("closing_time", &Parameters::closing_time);
  do_with("scene_folder", &Parameters::scene_folder);
}

void check_positive(const std::string& name, double value) {
  if (!std::isfinite(value) || value <= 0.0)
    refuse(name, "must be a number > 0, got " + shown(value));
}

void check(const Parameters& p) {
  check_positive("time_step", p.time_step);
  check_positive("publish_rate", p.publish_rate);
  if (p.publish_rate > kMostPublishRate)
    refuse("publish_rate",
           "must be at most " + shown(kMostPublishRate) + ", got " + shown(p.publish_rate));
  check_positive("closing_time", p.closing_time);
  if (!(p.real_time_factor >= 0.0 && p.real_time_factor <= kMostRealTimeFactor))
    refuse("real_time_factor", "must be from 0 to " + shown(kMostRealTimeFactor) + ", got " +
                                   shown(p.real_time_factor));
  if (p.world_frame.empty() || p.world_frame.front() == '/')
    refuse("world_frame", "must be a frame without a leading slash, got " + shown(p.world_frame));
  if (!p.frame_prefix.empty() && p.frame_prefix.front() == '/')
    refuse("frame_prefix", "must not begin with a slash, got " + shown(p.frame_prefix));
  struct stat status {};
  if (!p.scene_folder.empty() &&
      (::stat(p.scene_folder.c_str(), &status) != 0 || !S_ISDIR(status.st_mode)))
    refuse("scene_folder", "must be a folder that is there, got " + shown(p.scene_folder));
}

}  // namespace

Parameters read_parameters(const ros::NodeHandle& private_handle) {
  Parameters p;
  ros::param::get("/use_sim_time", p.use_sim_time);
  for_each([&](const char* name, auto member) {
    XmlRpc::XmlRpcValue found;
    if (private_handle.getParam(name, found) && !private_handle.getParam(name, p.*member))
      refuse(name, std::string("must be a ") + type_name(p.*member) + ", got " +
                       shortened(found.toXml(), 200));
  });
  check(p);
  for_each([&](const char* name, auto member) { private_handle.setParam(name, p.*member); });
  return p;
}

std::vector<std::string> unknown_parameters(const ros::NodeHandle& private_handle) {
  std::vector<std::string> known, all, sentences;
  for_each([&](const char* name, auto) { known.emplace_back(name); });
  private_handle.getParamNames(all);
  const std::string prefix = private_handle.getNamespace() + "/";
  for (const std::string& full : all) {
    if (full.compare(0, prefix.size(), prefix) != 0) continue;
    const std::string name = full.substr(prefix.size());
    const bool belongs_to_others = name.find('/') != std::string::npos;
    if (belongs_to_others || std::find(known.begin(), known.end(), name) != known.end()) continue;
    sentences.push_back("there is no parameter ~" + shortened(name) + did_you_mean(name, known));
  }
  return sentences;
}

std::string parameters_not_given(const Parameters& parameters, const std::set<std::string>& given) {
  const Parameters defaults;
  std::string text;
  for_each([&](const char* name, auto member) {
    if (given.count(name) > 0 || parameters.*member == defaults.*member) return;
    text += std::string(text.empty() ? "" : ", ") + "~" + name + " " + shown(parameters.*member);
  });
  return text;
}

}  // namespace constraint_sim
