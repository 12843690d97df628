#pragma once

#include <string>
#include <vector>

namespace constraint_sim::panel {

/// The motor of a constraint's length or first free coordinate.
struct Motor {
  std::string constraint;
  std::string key;  ///< key of set_constraint_properties: bias, motor_position or motor_force
  double value;     ///< value of `key`
};

inline bool same_motor(const Motor& a, const Motor& b) {
  return a.constraint == b.constraint && a.key == b.key;
}

/// Returns the motors in a scene from `save_scene`, at most `most`; none for other texts. Throws
/// std::runtime_error where a constraint with a motor cannot be read.
std::vector<Motor> motors_in(const std::string& scene, std::size_t most);

/// Returns the unit of a key, as text for users.
const char* unit_of(const std::string& key);

}  // namespace constraint_sim::panel
