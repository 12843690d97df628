#include "ros/laws.h"

#include <algorithm>
#include <iterator>
#include <set>
#include <stdexcept>
#include <string>
#include <utility>

namespace constraint_sim {
namespace {

using engine::CoordinateLaw;
using engine::CoordinateMotor;

[[noreturn]] void refuse(const std::string& field, const std::string& why) {
  throw std::invalid_argument(field + ": " + why);
}

struct LawKey {
  const char* name;
  void (*set)(CoordinateLaw& law, double value);
};

// of a message's fields too, where those are of the first coordinate
constexpr LawKey kLawKeys[] = {
    {"lower", [](CoordinateLaw& law, double value) { law.lower = value; }},
    {"upper", [](CoordinateLaw& law, double value) { law.upper = value; }},
    {"limit_restitution", [](CoordinateLaw& law, double value) { law.limit_restitution = value; }},
    {"friction", [](CoordinateLaw& law, double value) { law.friction = value; }},
    {"damping", [](CoordinateLaw& law, double value) { law.damping = value; }},
    {"stiffness", [](CoordinateLaw& law, double value) { law.stiffness = value; }},
    {"rest", [](CoordinateLaw& law, double value) { law.rest = value; }},
    {"frequency", [](CoordinateLaw& law, double value) { law.frequency = value; }},
    {"damping_ratio", [](CoordinateLaw& law, double value) { law.damping_ratio = value; }},
    {"position", [](CoordinateLaw& law, double value) { law.position = value; }},
    {"zero", [](CoordinateLaw& law, double value) { law.zero = value; }},
};

struct MotorKey {
  const char* name;
  void (*set)(CoordinateMotor& motor, double value);
};

constexpr MotorKey kMotorKeys[] = {
    {"bias", [](CoordinateMotor& motor, double value) { motor.bias = value; }},
    {"amplitude", [](CoordinateMotor& motor, double value) { motor.amplitude = value; }},
    {"motor_frequency", [](CoordinateMotor& motor, double value) { motor.frequency = value; }},
    {"phase", [](CoordinateMotor& motor, double value) { motor.phase = value; }},
    {"max_force", [](CoordinateMotor& motor, double value) { motor.max_force = value; }},
    {"timeout", [](CoordinateMotor& motor, double value) { motor.timeout = value; }},
    {"motor_position", [](CoordinateMotor& motor, double value) { motor.position = value; }},
    {"motor_force", [](CoordinateMotor& motor, double value) { motor.force = value; }},
    {"servo_frequency",
     [](CoordinateMotor& motor, double value) { motor.servo_frequency = value; }},
    {"servo_damping_ratio",
     [](CoordinateMotor& motor, double value) { motor.servo_damping_ratio = value; }},
    {"servo_stiffness",
     [](CoordinateMotor& motor, double value) { motor.servo_stiffness = value; }},
    {"servo_damping", [](CoordinateMotor& motor, double value) { motor.servo_damping = value; }},
    {"motor", [](CoordinateMotor&, double) {}},
};

template <class Keys>
auto find_key(const Keys& keys, const std::string& name) {
  return std::find_if(std::begin(keys), std::end(keys),
                      [&](const auto& key) { return name == key.name; });
}

// A motor is there once a key of it is given.
bool set_key(CoordinateLaw& law, const std::string& name, double value) {
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

// those of the fields that are not left out
void read_fields(const Constraint& msg, CoordinateLaw* law) {
  law->frequency = msg.frequency;
  law->damping_ratio = msg.damping_ratio;
  if (msg.bias != 0.0 || msg.amplitude != 0.0 || msg.max_force != 0.0) law->motor.emplace();
}

void read_motor_fields(const Constraint& msg, CoordinateLaw* law) {
  if (!law->motor) {
    for (const auto& [field, value] :
         {std::pair("motor_frequency", msg.motor_frequency), {"phase", msg.phase}})
      if (value != 0.0)
        refuse(field, "needs a motor: bias, amplitude, max_force or a key of it, got " +
                          std::to_string(value));
    return;
  }
  CoordinateMotor& motor = *law->motor;
  motor.bias = msg.bias;
  motor.amplitude = msg.amplitude;
  motor.frequency = msg.motor_frequency;
  motor.phase = msg.phase;
  motor.max_force = msg.max_force;
}

// The number before the slash of `1/stiffness`, which is taken off; 0 without one.
std::size_t take_coordinate(std::string* key) {
  if (key->size() < 3 || (*key)[1] != '/' || (*key)[0] < '1' || (*key)[0] > '9') return 0;
  const auto number = static_cast<std::size_t>((*key)[0] - '0');
  key->erase(0, 2);
  return number;
}

}  // namespace

void read_laws(const Constraint& msg, engine::Joint* joint) {
  const auto count = static_cast<std::size_t>(engine::coordinates(joint->kind));
  read_fields(msg, &joint->coordinates[0]);
  const std::set<std::string> fields{
      "bias", "amplitude", "phase", "max_force", "motor_frequency", "frequency", "damping_ratio"};
  for (std::size_t k = 0; k < msg.keys.size(); ++k) {
    const std::string& given = msg.keys[k];
    const double value = msg.values[k];
    std::string name = given;
    const std::size_t i = take_coordinate(&name);
    if (i >= count)
      refuse("keys", "'" + given + "': constraints of type '" + msg.type + "' have " +
                         std::to_string(count) + (count == 1 ? " coordinate" : " coordinates"));
    if (i == 0 && fields.count(name) > 0)
      refuse("keys", "'" + given + "' of the first coordinate is a field of the message");
    if (name == "motor" && value != 1.0)
      refuse("keys",
             "'" + given + "' must be 1 where there is a motor, got " + std::to_string(value));
    if (i == 0 && name == "break_torque")
      joint->break_torque = value;
    else if (i == 0 && name == "free" && joint->kind == engine::JointKind::kFreeDistance)
      continue;
    else if (i == 0 && name == "pitch" && joint->kind == engine::JointKind::kScrew)
      joint->pitch = value;
    else if (i == 0 && name == "value" && joint->kind == engine::JointKind::kScrew)
      joint->coupling.value = value;
    else if (!set_key(joint->coordinates[i], name, value))
      refuse("keys", "constraints of type '" + msg.type + "' have no '" + given + "'");
  }
  read_motor_fields(msg, &joint->coordinates[0]);
}

}  // namespace constraint_sim
