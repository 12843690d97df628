#include "ros/urdf_loader.h"

#include <ros/console.h>
#include <ros/names.h>
#include <ros/package.h>
#include <sys/stat.h>

#include <map>
#include <stdexcept>
#include <utility>

#include "ros/answer.h"
#include "ros/conversions.h"
#include "ros/guarded.h"
#include "ros/scenes.h"
#include "ros/time_conversions.h"
#include "sim/files.h"
#include "sim/words.h"

namespace constraint_sim {
namespace {

constexpr std::size_t kMostUrdfBytes = std::size_t{1} << 20;

bool is_file(const std::string& path) {
  struct stat status {};
  return ::stat(path.c_str(), &status) == 0 && S_ISREG(status.st_mode);
}

/// Finds meshes as rviz does. To look for a package takes milliseconds: it is done once.
class Meshes {
 public:
  bool exists(const std::string& name) {
    const std::string package = "package://", file = "file://";
    if (name.compare(0, file.size(), file) == 0) return is_file(name.substr(file.size()));
    if (name.compare(0, package.size(), package) != 0) return false;
    const std::string rest = name.substr(package.size());
    const std::size_t slash = rest.find('/');
    if (slash == std::string::npos) return false;
    const auto [found, is_new] = folders_.emplace(rest.substr(0, slash), "");
    if (is_new) found->second = ros::package::getPath(found->first);
    return !found->second.empty() && is_file(found->second + rest.substr(slash));
  }

 private:
  std::map<std::string, std::string> folders_;  // by package
};

struct Description {
  std::string urdf, extra;
};

// the file, and the YAML beside it
Description read_description(const std::string& name, const Parameters& parameters, Caller caller) {
  const std::string shipped = ros::package::getPath("constraint_sim") + "/config/robots/" + name;
  const bool is_shipped = name.find('/') == std::string::npos && is_file(shipped + ".urdf");
  const std::string path = is_shipped ? shipped + ".urdf" : file_named(name, parameters, caller);
  Description description;
  description.urdf = read_file(path);
  const std::size_t dot = path.rfind('.');
  if (dot == std::string::npos || path.find('/', dot) != std::string::npos) return description;
  const std::string beside = path.substr(0, dot) + ".yaml";
  if (is_file(beside)) description.extra = read_file(beside);
  return description;
}

BuiltRobot build_described(const Description& description, RobotOptions options) {
  if (description.urdf.size() > kMostUrdfBytes)
    throw std::invalid_argument("text: must be at most " + std::to_string(kMostUrdfBytes >> 20) +
                                " MiB, got " + std::to_string(description.urdf.size()) + " bytes");
  options.extra = description.extra;
  Meshes meshes;
  options.mesh_exists = [&](const std::string& name) { return meshes.exists(name); };
  return build_robot(description.urdf, options);
}

Robot add(const BuiltRobot& built, Robots* robots, World* world) {
  Robot robot = add_robot(built, world);
  robots->add(robot, *world);
  return robot;
}

void log(const Robot& robot) {
  ROS_INFO("robot %s: %zu bodies, %zu constraints", robot.name.c_str(), robot.bodies.size(),
           robot.constraints.size());
  for (const std::string& warning : robot.warnings)
    ROS_WARN("robot %s: %s", robot.name.c_str(), warning.c_str());
}

}  // namespace

void add_first_robot(const ros::NodeHandle& handle, const Parameters& parameters, Robots* robots,
                     World* world) {
  if (parameters.robot.empty()) return;
  try {
    Description description;
    std::string why;  // a path is no name of a parameter
    if (!ros::names::validate(parameters.robot, why) ||
        !handle.getParam(parameters.robot, description.urdf))
      description = read_description(parameters.robot, parameters, Caller::kParameter);
    if (!parameters.robot_extra.empty())
      description.extra =
          read_file(file_named(parameters.robot_extra, parameters, Caller::kParameter));
    RobotOptions options;
    options.prefix = parameters.robot_prefix;
    options.fixed = parameters.robot_fixed;
    options.pose.position = {parameters.robot_x, parameters.robot_y, parameters.robot_z};
    log(add(build_described(description, options), robots, world));
  } catch (const std::invalid_argument& error) {
    throw ParameterError("robot", "parameter ~robot: " + std::string(error.what()));
  }
}

UrdfLoader::UrdfLoader(Stepper& stepper, const Parameters& parameters, Robots& robots,
                       ros::NodeHandle handle)
    : stepper_(stepper), parameters_(parameters), robots_(robots) {
  server_ = guarded_service(handle, "load_urdf", &UrdfLoader::load, this);
}

bool UrdfLoader::load(LoadUrdfRequest& request, LoadUrdfResponse& response) {
  return answer(response, [&] {
    if (request.path.empty() == request.text.empty())
      throw std::invalid_argument("path, text: exactly one of the two is needed");
    Description description{request.text, ""};
    if (!request.path.empty())
      description = read_description(request.path, parameters_, Caller::kService);
    if (!request.extra.empty()) description.extra = request.extra;
    RobotOptions options;
    options.prefix = request.prefix;
    options.pose = from_msg(request.pose, geometry_msgs::Twist());
    options.fixed = request.fixed;
    const BuiltRobot built = build_described(description, options);
    Robot robot;
    const Boundary boundary = stepper_.edit(
        [&](World& world) { robot = add(built, &robots_, &world); }, Stepper::Duration::kMayBeLong);
    log(robot);
    response.applied_at = time_from_seconds(boundary.time);
    response.step = boundary.step;
    response.bodies = robot.bodies;
    response.constraints = robot.constraints;
    for (const std::string& warning : robot.warnings)
      response.status_message += (response.status_message.empty() ? "" : "; ") + warning;
  });
}

}  // namespace constraint_sim
