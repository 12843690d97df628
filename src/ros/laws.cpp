#include "ros/laws.h"

#include <optional>
#include <set>
#include <stdexcept>
#include <string>
#include <type_traits>

#include "engine/model/fields.h"
#include "sim/errors.h"

namespace constraint_sim {
namespace {

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

// Returns the key of a field of a motor: three of the names could be taken for fields of the law.
std::string key_of_motor(const std::string& field) {
  const bool is_like_law = field == "frequency" || field == "position" || field == "force";
  return is_like_law ? "motor_" + field : field;
}

// Sets the field with this key; returns false where no field has this key.
template <class List, class Struct>
bool set_field(const List& list, const std::string& key, double value, Struct* target) {
  bool is_known = false;
  engine::visit_list(list, *target, [&](const char* field, auto& member, auto) {
    if (key != (std::is_same_v<Struct, engine::Motor> ? key_of_motor(field) : field)) return;
    is_known = true;
    if constexpr (std::is_same_v<decltype(member), bool&>)
      member = flag(value, field);
    else if constexpr (std::is_assignable_v<decltype(member), double>)
      member = value;
  });
  return is_known;
}

// Sets a key of a law. The first key of a motor adds the motor.
bool set_key(const std::string& key, double value, engine::CoordinateLaw* law) {
  if (set_field(engine::kFields<engine::CoordinateLaw>, key, value, law)) return true;
  engine::Motor motor = law->motor.value_or(engine::Motor{});
  if (!set_field(engine::kFields<engine::Motor>, key, value, &motor)) return false;
  law->motor = motor;
  return true;
}

// Switches the motor between rate, position and force: a key of one kind clears the other kinds.
void choose_motor(const std::string& key, engine::CoordinateLaw* law) {
  const bool is_rate = key == "bias" || key == "amplitude";
  if (!law->motor || !(is_rate || key == "motor_position" || key == "motor_force")) return;
  engine::Motor& motor = *law->motor;
  if (!is_rate) motor.bias = motor.amplitude = 0.0;
  if (key != "motor_force") motor.force.reset();
  if (key == "motor_position") return;
  motor.position.reset();
  motor.servo_stiffness = motor.servo_damping = 0.0;
}

bool set_property(const std::string& given, double value, engine::Joint* joint) {
  if (set_field(engine::kJointSettings, given, value, joint)) return true;
  if (engine::DistanceJoint* const distance = engine::if_distance(*joint))
    return set_field(engine::kFields<engine::DistanceJoint>, given, value, distance) ||
           set_field(engine::kVelocityMotor, given, value, &joint->motor);
  std::string name = given;
  const std::size_t i = take_coordinate(&name);
  if (i >= static_cast<std::size_t>(engine::info(joint->kind).coordinates)) return false;
  engine::CoordinateLaw& law = joint->coordinates[i];
  if (name != "motor") return set_key(name, value, &law);
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
