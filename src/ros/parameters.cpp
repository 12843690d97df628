#include "ros/parameters.h"

#include <ros/names.h>
#include <ros/param.h>
#include <sys/stat.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <iterator>
#include <map>
#include <sstream>

#include "ros/topic_names.h"
#include "sim/words.h"

namespace constraint_sim {
namespace {

constexpr double kMostRealTimeFactor = 1e6;
constexpr double kMostPublishRate = 1e4;  // [Hz]

[[noreturn]] void refuse_parameter(const std::string& name, const std::string& why) {
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

std::string shown(XmlRpc::XmlRpcValue& value) {
  switch (value.getType()) {
    case XmlRpc::XmlRpcValue::TypeBoolean:
      return shown(static_cast<bool>(value));
    case XmlRpc::XmlRpcValue::TypeInt:
      return std::to_string(static_cast<int>(value));
    case XmlRpc::XmlRpcValue::TypeDouble:
      return shown(static_cast<double>(value));
    case XmlRpc::XmlRpcValue::TypeString:
      return shown(static_cast<std::string>(value));
    case XmlRpc::XmlRpcValue::TypeArray:
      return "a list";
    case XmlRpc::XmlRpcValue::TypeStruct:
      return "a map";
    default:
      return "a value of another type";
  }
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
  do_with("hands", &Parameters::hands);
  do_with("diagnostics_real_time_factor", &Parameters::diagnostics_real_time_factor);
  do_with("diagnostics_constraint_error", &Parameters::diagnostics_constraint_error);
  do_with("robot", &Parameters::robot);
  do_with("robot_extra", &Parameters::robot_extra);
  do_with("robot_prefix", &Parameters::robot_prefix);
  do_with("robot_fixed", &Parameters::robot_fixed);
  do_with("robot_x", &Parameters::robot_x);
  do_with("robot_y", &Parameters::robot_y);
  do_with("robot_z", &Parameters::robot_z);
  do_with("publish_links", &Parameters::publish_links);
  do_with("publish_com", &Parameters::publish_com);
  do_with("command", &Parameters::command);
  do_with("cmd_vel", &Parameters::cmd_vel);
  do_with("wrench", &Parameters::wrench);
  do_with("odometry", &Parameters::odometry);
  do_with("goal_tolerance", &Parameters::goal_tolerance);
  do_with("goal_time_tolerance", &Parameters::goal_time_tolerance);
  do_with("plugins", &Parameters::plugins);
  do_with("follow", &Parameters::follow);
  do_with("follow_delay", &Parameters::follow_delay);
}

void check_positive(const std::string& name, double value) {
  if (!std::isfinite(value) || value <= 0.0)
    refuse_parameter(name, "must be a number > 0, got " + shown(value));
}

// Returns whether a part of a name is empty, as in `/a`, `a//b` and `a/`.
bool has_empty_part(const std::string& name) {
  return name.empty() || name.front() == '/' || name.back() == '/' ||
         name.find("//") != std::string::npos;
}

void check_names(const std::string& parameter, const std::string& names) {
  std::map<std::string, std::string> name_of_topic;
  for (const std::string& name : names_in(names)) {
    std::string why;
    if (has_empty_part(name)) why = "a part between slashes is empty";
    if (!why.empty() || !ros::names::validate(topic_of(parameter, name), why))
      refuse_parameter(parameter, "no topic can have the name " + shown(name) + ": " + why);
    const auto [other, is_first] = name_of_topic.emplace(topic_of(parameter, name), name);
    if (!is_first)
      refuse_parameter(parameter, other->second == name
                                      ? "has " + shown(name) + " twice"
                                      : shown(other->second) + " and " + shown(name) +
                                            " would have the same topic " + other->first);
  }
}

void check(const Parameters& p) {
  check_positive("time_step", p.time_step);
  check_publish_rate(p.publish_rate);
  check_positive("closing_time", p.closing_time);
  check_real_time_factor(p.real_time_factor);
  check_positive("diagnostics_constraint_error", p.diagnostics_constraint_error);
  if (!(p.diagnostics_real_time_factor >= 0.0 && p.diagnostics_real_time_factor <= 1.0))
    refuse_parameter("diagnostics_real_time_factor",
                     "must be from 0 to 1, got " + shown(p.diagnostics_real_time_factor));
  if (has_empty_part(p.world_frame))
    refuse_parameter("world_frame", "must be a frame without empty parts between slashes, got " +
                                        shown(p.world_frame));
  for (const auto& [name, prefix] :
       {std::pair("frame_prefix", p.frame_prefix), std::pair("robot_prefix", p.robot_prefix)})
    if (!prefix.empty() && has_empty_part(prefix + "x"))
      refuse_parameter(name,
                       "must not begin with a slash or have two in a row, got " + shown(prefix));
  if (p.publish_links != "all" && p.publish_links != "root" && p.publish_links != "none")
    refuse_parameter("publish_links", "must be all, root or none, got " + shown(p.publish_links));
  for (const auto& [name, value] : {std::pair("goal_tolerance", p.goal_tolerance),
                                    std::pair("goal_time_tolerance", p.goal_time_tolerance)})
    if (!std::isfinite(value) || value < 0.0)
      refuse_parameter(name, "must be a number >= 0, got " + shown(value));
  check_names("command", p.command);
  check_names("cmd_vel", p.cmd_vel);
  check_names("wrench", p.wrench);
  check_names("odometry", p.odometry);
  followed_in(p.follow);
  if (!(p.follow_delay >= 0.0 && p.follow_delay <= 5.0))  // tf keeps 10 s
    refuse_parameter("follow_delay", "must be from 0 to 5, got " + shown(p.follow_delay));
  struct stat status {};
  if (!p.scene_folder.empty() &&
      (::stat(p.scene_folder.c_str(), &status) != 0 || !S_ISDIR(status.st_mode)))
    refuse_parameter("scene_folder",
                     "must be a folder that is there, got " + shown(p.scene_folder));
}

}  // namespace

void check_real_time_factor(double value) {
  if (!(value >= 0.0 && value <= kMostRealTimeFactor))
    refuse_parameter("real_time_factor",
                     "must be from 0 to " + shown(kMostRealTimeFactor) + ", got " + shown(value));
}

void check_publish_rate(double value) {
  check_positive("publish_rate", value);
  if (value > kMostPublishRate)
    refuse_parameter("publish_rate",
                     "must be at most " + shown(kMostPublishRate) + ", got " + shown(value));
}

std::vector<std::string> names_in(const std::string& parameter) {
  std::istringstream words(parameter);
  return {std::istream_iterator<std::string>(words), {}};
}

std::vector<std::pair<std::string, std::string>> followed_in(const std::string& parameter) {
  std::vector<std::pair<std::string, std::string>> followed;
  for (const std::string& pair : names_in(parameter)) {
    const std::size_t middle = pair.find('=');
    const std::string body = pair.substr(0, middle);
    const std::string frame = middle == std::string::npos ? "" : pair.substr(middle + 1);
    if (body.empty() || has_empty_part(frame))
      refuse_parameter(
          "follow",
          "must be BODY=FRAME, frames without empty parts between slashes, got " + shown(pair));
    for (const auto& before : followed)
      if (before.first == body)
        refuse_parameter("follow", "has the body " + shown(body) + " twice");
    followed.emplace_back(body, frame);
  }
  return followed;
}

std::vector<std::string> parameter_names() {
  std::vector<std::string> names;
  for_each([&](const char* name, auto) { names.emplace_back(name); });
  return names;
}

Parameters read_parameters(const ros::NodeHandle& private_handle) {
  Parameters p;
  ros::param::get("/use_sim_time", p.use_sim_time);
  for_each([&](const char* name, auto member) {
    XmlRpc::XmlRpcValue found;
    if (private_handle.getParam(name, found) && !private_handle.getParam(name, p.*member))
      refuse_parameter(name,
                       std::string("must be a ") + type_name(p.*member) + ", got " + shown(found));
  });
  check(p);
  for_each([&](const char* name, auto member) { private_handle.setParam(name, p.*member); });
  return p;
}

std::vector<std::string> unknown_parameters(const ros::NodeHandle& private_handle) {
  const std::vector<std::string> known = parameter_names();
  std::vector<std::string> all, sentences;
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
