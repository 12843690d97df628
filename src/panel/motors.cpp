#include "panel/motors.h"

#include <yaml-cpp/yaml.h>

namespace constraint_sim::panel {
namespace {

Motor read_motor(const std::string& constraint, const YAML::Node& motor) {
  if (motor["position"]) return {constraint, "motor_position", motor["position"].as<double>()};
  if (motor["force"]) return {constraint, "motor_force", motor["force"].as<double>()};
  return {constraint, "bias", motor["bias"].as<double>(0.0)};
}

// a joint of several coordinates has a list of them
YAML::Node first_motor(const YAML::Node& constraint) {
  if (constraint["motor"]) return constraint["motor"];
  const YAML::Node coordinates = constraint["coordinates"];
  if (coordinates && coordinates.IsSequence() && coordinates.size() > 0)
    return coordinates[0]["motor"];
  return YAML::Node(YAML::NodeType::Undefined);
}

}  // namespace

std::vector<Motor> motors_in(const std::string& scene, std::size_t most) {
  std::vector<Motor> motors;
  const YAML::Node root = YAML::Load(scene);
  for (const YAML::Node& constraint : root["constraints"]) {
    const YAML::Node motor = first_motor(constraint);
    if (!motor || !motor.IsMap()) continue;
    if (motors.size() == most) break;
    motors.push_back(read_motor(constraint["name"].as<std::string>(), motor));
  }
  return motors;
}

const char* unit_of(const std::string& key) {
  if (key == "motor_position") return "m, rad";
  return key == "motor_force" ? "N, N m" : "m/s, rad/s";
}

}  // namespace constraint_sim::panel
