#include "ros/laws.h"

#include <algorithm>
#include <iterator>
#include <set>
#include <stdexcept>
#include <string>
#include <utility>

#include "sim/errors.h"

namespace constraint_sim {
namespace {

struct LawKey {
  const char* name;
  void (*set)(engine::CoordinateLaw& law, double value);
};

// Keys of laws.
constexpr LawKey kLawKeys[] = {
    {"lower", [](engine::CoordinateLaw& law, double value) { law.lower = value; }},
    {"upper", [](engine::CoordinateLaw& law, double value) { law.upper = value; }},
    {"limit_restitution",
     [](engine::CoordinateLaw& law, double value) { law.limit_restitution = value; }},
    {"friction", [](engine::CoordinateLaw& law, double value) { law.friction = value; }},
    {"damping", [](engine::CoordinateLaw& law, double value) { law.damping = value; }},
    {"stiffness", [](engine::CoordinateLaw& law, double value) { law.stiffness = value; }},
    {"rest", [](engine::CoordinateLaw& law, double value) { law.rest = value; }},
    {"frequency", [](engine::CoordinateLaw& law, double value) { law.frequency = value; }},
    {"damping_ratio", [](engine::CoordinateLaw& law, double value) { law.damping_ratio = value; }},
    {"position", [](engine::CoordinateLaw& law, double value) { law.position = value; }},
    {"zero", [](engine::CoordinateLaw& law, double value) { law.zero = value; }},
};

struct MotorKey {
  const char* name;
  void (*set)(engine::CoordinateMotor& motor, double value);
};

constexpr MotorKey kMotorKeys[] = {
    {"bias", [](engine::CoordinateMotor& motor, double value) { motor.bias = value; }},
    {"amplitude", [](engine::CoordinateMotor& motor, double value) { motor.amplitude = value; }},
    {"motor_frequency",
     [](engine::CoordinateMotor& motor, double value) { motor.frequency = value; }},
    {"phase", [](engine::CoordinateMotor& motor, double value) { motor.phase = value; }},
    {"max_force", [](engine::CoordinateMotor& motor, double value) { motor.max_force = value; }},
    {"timeout", [](engine::CoordinateMotor& motor, double value) { motor.timeout = value; }},
    {"motor_position",
     [](engine::CoordinateMotor& motor, double value) { motor.position = value; }},
    {"motor_force", [](engine::CoordinateMotor& motor, double value) { motor.force = value; }},
    {"servo_frequency",
     [](engine::CoordinateMotor& motor, double value) { motor.servo_frequency = value; }},
    {"servo_damping_ratio",
     [](engine::CoordinateMotor& motor, double value) { motor.servo_damping_ratio = value; }},
    {"servo_stiffness",
     [](engine::CoordinateMotor& motor, double value) { motor.servo_stiffness = value; }},
    {"servo_damping",
     [](engine::CoordinateMotor& motor, double value) { motor.servo_damping = value; }},
    {"motor", [](engine::CoordinateMotor&, double) {}},
};

template <class Keys>
auto find_key(const Keys& keys, const std::string& name) {
  return std::find_if(std::begin(keys), std::end(keys),
                      [&](const auto& key) { return name == key.name; });
}

// Sets a key of a law. The first key of a motor adds the motor.
bool set_key(engine::CoordinateLaw& law, const std::string& name, double value) {
  const auto* const key = find_key(kLawKeys, name);
  if (key != std::end(kLawKeys)) {
    key->set(law, value);
    return true;
  }
  const auto* const motor_key = find_key(kMotorKeys, name);
  if (motor_key == std::end(kMotorKeys)) return false;
  if (!law.motor) law.motor.emplace();
  motor_key->set(*law.motor, value);
  return true;
}

// Takes the prefix `1/` off a key such as `1/stiffness` and returns its number; 0 without one.
std::size_t take_coordinate(std::string* key) {
  if (key->size() < 3 || (*key)[1] != '/' || (*key)[0] < '1' || (*key)[0] > '9') return 0;
  const auto number = static_cast<std::size_t>((*key)[0] - '0');
  key->erase(0, 2);
  return number;
}

bool flag(double value, const char* field) {
  if (value != 0.0 && value != 1.0) refuse(field, "must be 0 or 1, got " + std::to_string(value));
  return value == 1.0;
}

using engine::Joint;

struct JointKey {
  const char* name;
  void (*set)(Joint& joint, double value);
};

constexpr JointKey kJointKeys[] = {
    {"enabled", [](Joint& joint, double value) { joint.enabled = flag(value, "enabled"); }},
    {"collide_connected",
     [](Joint& joint, double value) {
       joint.collide_connected = flag(value, "collide_connected");
     }},
    {"break_force", [](Joint& joint, double value) { joint.break_force = value; }},
    {"break_torque", [](Joint& joint, double value) { joint.break_torque = value; }},
    {"baumgarte", [](Joint& joint, double value) { joint.baumgarte = value; }},
};

constexpr JointKey kDistanceKeys[] = {
    {"length", [](Joint& joint, double value) { joint.distance.length = value; }},
    {"min_length", [](Joint& joint, double value) { joint.distance.min_length = value; }},
    {"max_length", [](Joint& joint, double value) { joint.distance.max_length = value; }},
    {"frequency", [](Joint& joint, double value) { joint.distance.frequency = value; }},
    {"damping_ratio", [](Joint& joint, double value) { joint.distance.damping_ratio = value; }},
    {"stiffness", [](Joint& joint, double value) { joint.distance.stiffness = value; }},
    {"damping", [](Joint& joint, double value) { joint.distance.damping = value; }},
    {"one_sided",
     [](Joint& joint, double value) { joint.distance.one_sided = flag(value, "one_sided"); }},
    {"bias", [](Joint& joint, double value) { joint.motor.bias = value; }},
    {"amplitude", [](Joint& joint, double value) { joint.motor.amplitude = value; }},
    {"motor_frequency", [](Joint& joint, double value) { joint.motor.frequency = value; }},
    {"phase", [](Joint& joint, double value) { joint.motor.phase = value; }},
    {"max_force", [](Joint& joint, double value) { joint.motor.max_force = value; }},
    {"timeout", [](Joint& joint, double value) { joint.motor.timeout = value; }},
};

// Switches the motor between rate, position and force: a key of one kind clears the other kinds.
void choose_motor(const std::string& key, engine::CoordinateLaw* law) {
  const bool is_rate = key == "bias" || key == "amplitude";
  if (!law->motor || !(is_rate || key == "motor_position" || key == "motor_force")) return;
  engine::CoordinateMotor& motor = *law->motor;
  if (!is_rate) motor.bias = motor.amplitude = 0.0;
  if (key != "motor_force") motor.force.reset();
  if (key == "motor_position") return;
  motor.position.reset();
  motor.servo_stiffness = motor.servo_damping = 0.0;
}

template <class Keys>
bool set_by_key(const Keys& keys, const std::string& name, double value, Joint* joint) {
  const auto* const key = find_key(keys, name);
  if (key == std::end(keys)) return false;
  key->set(*joint, value);
  return true;
}

bool set_property(const std::string& given, double value, Joint* joint) {
  if (set_by_key(kJointKeys, given, value, joint)) return true;
  if (engine::if_distance(*joint) != nullptr) return set_by_key(kDistanceKeys, given, value, joint);
  std::string name = given;
  const std::size_t i = take_coordinate(&name);
  if (i >= static_cast<std::size_t>(engine::coordinates(joint->kind))) return false;
  engine::CoordinateLaw& law = joint->coordinates[i];
  if (name != "motor") return set_key(law, name, value);
  if (!flag(value, given.c_str()))
    law.motor.reset();
  else if (!law.motor)
    law.motor.emplace();
  return true;
}

}  // namespace

void change_properties(const std::vector<std::string>& keys, const std::vector<double>& values,
                       engine::Joint* joint) {
  if (keys.size() != values.size())
    refuse("values", "must be as many as keys, got " + std::to_string(values.size()) + " for " +
                         std::to_string(keys.size()));
  std::set<std::string> seen;
  for (const std::string& key : keys) {
    if (!seen.insert(key).second) refuse("keys", "'" + key + "' is there twice");
    std::string name = key;
    const std::size_t i = take_coordinate(&name);
    if (i < joint->coordinates.size()) choose_motor(name, &joint->coordinates[i]);
  }
  for (std::size_t k = 0; k < keys.size(); ++k)
    if (!set_property(keys[k], values[k], joint))
      refuse("keys", "constraints of type '" + std::string(engine::name(joint->kind)) +
                         "' have no '" + keys[k] + "' to change");
}

}  // namespace constraint_sim
