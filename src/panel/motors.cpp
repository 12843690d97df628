#include "panel/motors.h"

#include <yaml-cpp/yaml.h>

#include <algorithm>

namespace constraint_sim::panel {
namespace {

Motor read_motor(const std::string& constraint, const YAML::Node& motor) {
  if (motor["position"]) return {constraint, "motor_position", motor["position"].as<double>()};
  if (motor["force"]) return {constraint, "motor_force", motor["force"].as<double>()};
  return {constraint, "bias", motor["bias"].as<double>(0.0)};
}

// Returns the motor of a constraint; joints with several coordinates have a list of coordinates.
YAML::Node first_motor(const YAML::Node& constraint) {
  if (constraint["motor"]) return constraint["motor"];
  const YAML::Node coordinates = constraint["coordinates"];
  if (coordinates && coordinates.IsSequence() && coordinates.size() > 0)
    return coordinates[0]["motor"];
  return YAML::Node(YAML::NodeType::Undefined);
}

// Returns the indented lines below a key.
std::string lines_of(const std::string& key, const std::string& scene) {
  const std::string title = '\n' + key + ":\n";
  const std::size_t found = scene.find(title);
  if (found == std::string::npos) return "";
  const std::size_t begin = found + title.size();
  std::size_t end = begin;
  while (end < scene.size() && scene[end] == ' ')
    end = std::min(scene.find('\n', end), scene.size() - 1) + 1;
  return scene.substr(begin, end - begin);
}

}  // namespace

// Parses only constraints with a motor, since rviz is blocked meanwhile. constraint_sim_panel_costs
// prints the time for thousands of constraints.
std::vector<Motor> motors_in(const std::string& scene, std::size_t most) {
  std::vector<Motor> motors;
  const std::string text = lines_of("constraints", scene);
  const std::size_t dash = text.find_first_not_of(' ');
  if (dash == std::string::npos || text[dash] != '-') return motors;
  const std::string begin = '\n' + text.substr(0, dash + 1);  // start of each constraint
  for (std::size_t at = 0; at < text.size() && motors.size() < most;) {
    const std::size_t next = std::min(text.find(begin, at), text.size() - 1) + 1;
    const std::string item = text.substr(at, next - at);
    at = next;
    if (item.find("motor: ") == std::string::npos) continue;
    const YAML::Node constraint = YAML::Load(item)[0];
    const YAML::Node motor = first_motor(constraint);
    if (motor && motor.IsMap())
      motors.push_back(read_motor(constraint["name"].as<std::string>(), motor));
  }
  return motors;
}

const char* unit_of(const std::string& key) {
  if (key == "motor_position") return "m, rad";
  return key == "motor_force" ? "N, N m" : "m/s, rad/s";
}

}  // namespace constraint_sim::panel
