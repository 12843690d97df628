#include "ros/urdf_loader.h"

#include <ros/console.h>
#include <ros/names.h>
#include <ros/package.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <climits>
#include <cstdlib>
#include <optional>
#include <sstream>
#include <stdexcept>
#include <utility>

#include "ros/answer.h"
#include "ros/conversions.h"
#include "ros/guarded.h"
#include "ros/mesh_files.h"
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

struct Description {
  std::string urdf, extra, srdf;
  std::string path;  ///< file of the URDF; empty: not from a file

  /// Absolute path of the folder of the file; empty without one.
  std::string folder() const;
};

std::string Description::folder() const {
  if (path.empty()) return "";
  const std::size_t slash = path.rfind('/');
  const std::string given = slash == std::string::npos ? "." : path.substr(0, slash + 1);
  std::array<char, PATH_MAX> absolute{};
  return ::realpath(given.c_str(), absolute.data()) == nullptr ? "" : absolute.data();
}

bool is_on_path(const std::string& program) {
  const char* const folders = std::getenv("PATH");
  std::istringstream list(folders == nullptr ? "" : folders);
  for (std::string folder; std::getline(list, folder, ':');) {
    const std::string file = folder + "/" + program;
    if (is_file(file) && ::access(file.c_str(), X_OK) == 0) return true;
  }
  return false;
}

/// Returns the command that expands xacro, or the advice to install xacro.
std::string how_to_expand(const std::string& path) {
  if (!is_on_path("xacro")) return "the program xacro, which is not installed here, expands it";
  if (path.empty()) return "`xacro FILE > expanded.urdf` expands it";
  return "`xacro '" + path + "' > expanded.urdf` expands it";
}

/// Returns suggestions for an unknown name, as the end of a sentence.
std::string what_was_meant(const std::string& name, const std::vector<std::string>& shipped,
                           Caller caller) {
  const bool is_parameter = caller == Caller::kParameter;
  if (name.find('/') == std::string::npos) {
    std::string hint = is_parameter ? ", there is no text in a parameter of that name" : "";
    hint += ", and no robot of that name comes with the package, which has";
    for (const std::string& robot : shipped) hint += " " + robot;
    return hint + did_you_mean(name, shipped);
  }
  std::array<char, PATH_MAX> folder{};
  const bool is_relative =
      name[0] != '/' && name[0] != '~' && name.find("://") == std::string::npos;
  if (!is_parameter || !is_relative || ::getcwd(folder.data(), folder.size()) == nullptr) return "";
  return std::string("; relative paths start at ") + folder.data();
}

// Reads the URDF, and the YAML and the SRDF beside it.
Description read_description(const std::string& name, const Parameters& parameters, Caller caller) {
  const std::string folder = ros::package::getPath("constraint_sim") + "/config/robots/";
  const std::vector<std::string> shipped = names_in_folder(folder, ".urdf");
  const bool is_shipped = std::find(shipped.begin(), shipped.end(), name) != shipped.end();
  const std::string path =
      is_shipped ? folder + name + ".urdf" : file_named(name, parameters, caller);
  Description description;
  description.path = path;
  try {
    description.urdf = read_file(path);
  } catch (const std::invalid_argument& error) {
    throw std::invalid_argument(error.what() + what_was_meant(name, shipped, caller));
  }
  const std::size_t dot = path.rfind('.');
  if (dot == std::string::npos || path.find('/', dot) != std::string::npos) return description;
  const auto read_beside = [&](const char* ending, std::string* text) {
    const std::string beside = path.substr(0, dot) + ending;
    if (is_file(beside)) *text = read_file(beside);
  };
  read_beside(".yaml", &description.extra);
  read_beside(".srdf", &description.srdf);
  return description;
}

/// Returns the text in a parameter; `~` begins the name of a private one. None where the parameter
/// is missing or holds no text, and for names that no parameter can have, such as a path with a
/// dot.
std::optional<std::string> text_in_parameter(const std::string& name, const ros::NodeHandle& handle,
                                             const ros::NodeHandle& private_handle) {
  const bool is_private = name[0] == '~';
  const std::string key = is_private ? name.substr(1) : name;
  std::string why, text;
  if (!ros::names::validate(key, why) || key.empty() || key[0] == '~') return std::nullopt;
  if (is_private && key[0] == '/') return std::nullopt;  // a path in the home folder
  if (!(is_private ? private_handle : handle).getParam(key, text)) return std::nullopt;
  return text;
}

BuiltRobot build_described(const Description& description, RobotOptions options) {
  if (description.urdf.size() > kMostUrdfBytes)
    throw std::invalid_argument("text: must be at most " + std::to_string(kMostUrdfBytes >> 20) +
                                " MiB, got " + std::to_string(description.urdf.size()) + " bytes");
  options.extra = description.extra;
  options.srdf = description.srdf;
  options.folder = description.folder();
  options.how_to_expand = how_to_expand(description.path);
  MeshFiles meshes;
  options.mesh_path = [&](const std::string& name) { return meshes.path(name); };
  options.mesh_exists = [&](const std::string& name) { return !meshes.path(name).empty(); };
  return build_robot(description.urdf, options);
}

Robot add(const BuiltRobot& built, const Description& description, const std::string& prefix,
          Robots* robots, World* world) {
  Robot robot = add_robot(built, world);
  const std::string& urdf = built.urdf.empty() ? description.urdf : built.urdf;
  robots->add(robot, {urdf, description.folder()}, prefix, *world);
  return robot;
}

void log(const Robot& robot) {
  ROS_INFO("robot %s: %zu bodies, %zu constraints", robot.name.c_str(), robot.bodies.size(),
           robot.constraints.size());
  for (const std::string& warning : robot.warnings)
    ROS_WARN("robot %s: %s", robot.name.c_str(), warning.c_str());
}

}  // namespace

void add_first_robot(const ros::NodeHandle& handle, const ros::NodeHandle& private_handle,
                     const Parameters& parameters, Robots* robots, World* world) {
  if (parameters.robot.empty()) return;
  try {
    Description description;
    if (const auto text = text_in_parameter(parameters.robot, handle, private_handle)) {
      description.urdf = *text;
      // as MoveIt names it
      const std::string semantic = parameters.robot + "_semantic";
      description.srdf = text_in_parameter(semantic, handle, private_handle).value_or("");
    } else {
      description = read_description(parameters.robot, parameters, Caller::kParameter);
    }
    if (!parameters.robot_extra.empty())
      description.extra =
          read_file(file_named(parameters.robot_extra, parameters, Caller::kParameter));
    RobotOptions options;
    options.prefix = parameters.robot_prefix;
    options.fixed = parameters.robot_fixed;
    options.pose.position = {parameters.robot_x, parameters.robot_y, parameters.robot_z};
    const BuiltRobot built = build_described(description, options);
    log(add(built, description, options.prefix, robots, world));
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
    if (stepper_.is_stopping()) throw Cancelled();  // meshes of waiting calls would take minutes
    if (request.path.empty() == request.text.empty())
      throw std::invalid_argument("path, text: exactly one of the two is needed");
    Description description{request.text, "", "", ""};
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
        [&](World& world) { robot = add(built, description, options.prefix, &robots_, &world); },
        Stepper::Duration::kMayBeLong);
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
