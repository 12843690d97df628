// Prints the shipped configuration of rviz with a view that fits a scene:
//   rosrun constraint_sim rviz_config SCENE > FILE.rviz       for a scene as load_scene takes it
//   rosrun constraint_sim rviz_config --node NODE > FILE.rviz for a simulator in its present state
//   rosrun constraint_sim rviz_config --open NODE [ARGUMENTS OF RVIZ]
// With --open it starts rviz, as the launch file does; in the shipped view where the simulator does
// not answer.

#include <constraint_sim/SaveScene.h>
#include <ros/init.h>
#include <ros/package.h>
#include <ros/service.h>
#include <ros/this_node.h>
#include <unistd.h>
#include <yaml-cpp/yaml.h>

#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <exception>
#include <fstream>
#include <sstream>
#include <stdexcept>
#include <string>
#include <vector>

#include "constraint_sim/engine/scene.h"
#include "ros/scenes.h"
#include "ros/view.h"

namespace constraint_sim {
namespace {

constexpr double kPatience = 10.0;    // time for a simulator to start [s]
constexpr double kOfDistance = 0.06;  // length of the axes of frames over the distance of the eye

std::string shipped() {
  return ros::package::getPath("constraint_sim") + "/config/constraint_sim.rviz";
}

engine::World world_of_node(const std::string& node) {
  const std::string service = ros::names::resolve(node) + "/save_scene";
  SaveScene call;
  if (!ros::service::waitForService(service, ros::Duration(kPatience)) ||
      !ros::service::call(service, call))
    throw std::runtime_error("no answer of " + service);
  ros::shutdown();
  if (!call.response.success) throw std::runtime_error(call.response.status_message);
  return engine::load_scene(call.response.text, node);
}

// Returns the largest number of 1, 2 or 5 times a power of ten that is not above `length`.
double round_length(double length) {
  const double power = std::pow(10.0, std::floor(std::log10(length)));
  for (const double first : {5.0, 2.0})
    if (first * power <= length) return first * power;
  return power;
}

std::string configuration(const engine::World& world) {
  const View view = fitted_view(seen_extent(world));
  YAML::Node config = YAML::LoadFile(shipped());
  YAML::Node manager = config["Visualization Manager"];
  YAML::Node current = manager["Views"]["Current"];
  current["Focal Point"]["X"] = view.focal_point.x();
  current["Focal Point"]["Y"] = view.focal_point.y();
  current["Focal Point"]["Z"] = view.focal_point.z();
  current["Distance"] = view.distance;
  current["Pitch"] = view.pitch;
  current["Yaw"] = view.yaw;
  current["Near Clip Distance"] = 1e-3 * view.distance;
  current["Focal Shape Size"] = 0.01 * view.distance;
  for (YAML::Node saved : manager["Views"]["Saved"]) saved["Distance"] = view.distance;
  for (YAML::Node display : manager["Displays"]) {
    const std::string kind = display["Class"].as<std::string>();
    if (kind == "rviz/Grid") display["Cell Size"] = round_length(0.16 * view.distance);
    if (kind == "rviz/TF") display["Marker Scale"] = kOfDistance * view.distance;
  }
  std::ostringstream text;
  text << config << '\n';
  return text.str();
}

// Starts rviz in place of this process.
int open(const std::string& node, char** arguments) {
  std::string file = shipped();
  try {
    const std::string text = configuration(world_of_node(node));
    char name[] = "/tmp/constraint_sim_XXXXXX.rviz";
    const int descriptor = ::mkstemps(name, 5);
    if (descriptor < 0) throw std::runtime_error("no file can be made in /tmp");
    ::close(descriptor);
    std::ofstream(name) << text;
    file = name;
  } catch (const std::exception& error) {
    std::fprintf(stderr, "rviz_config: %s; rviz opens with its shipped view\n", error.what());
  }
  ros::shutdown();
  std::vector<char*> command;
  std::string program = "rviz", option = "-d";
  for (std::string* word : {&program, &option, &file}) command.push_back(word->data());
  for (; *arguments != nullptr; ++arguments) command.push_back(*arguments);
  command.push_back(nullptr);
  ::execvp("rviz", command.data());
  std::perror("rviz_config: rviz");
  return 1;
}

int run(int argc, char** argv) {
  const std::string first = argc > 1 ? argv[1] : "";
  const bool opens = first == "--open", is_node = opens || first == "--node";
  if (argc < (is_node ? 3 : 2) || (!opens && argc > (is_node ? 3 : 2))) {
    std::fputs("usage: rosrun constraint_sim rviz_config SCENE | --node NODE | --open NODE [...]\n",
               stderr);
    return 2;
  }
  if (is_node) {  // under an anonymous name: rviz takes the name that it is started with
    ros::init(ros::M_string(), "rviz_config", ros::init_options::AnonymousName);
    ros::start();
  }
  if (opens) return open(argv[2], argv + 3);
  const engine::World world =
      is_node ? world_of_node(argv[2]) : load_world(first, "", Parameters(), Caller::kParameter);
  std::fputs(configuration(world).c_str(), stdout);
  return 0;
}

}  // namespace
}  // namespace constraint_sim

int main(int argc, char** argv) {
  try {
    return constraint_sim::run(argc, argv);
  } catch (const std::exception& error) {
    std::fprintf(stderr, "rviz_config: %s\n", error.what());
    return 2;
  }
}
