#pragma once

#include <string>
#include <vector>

namespace constraint_sim::panel {

/// The motor of a constraint's length or first free coordinate.
struct Motor {
  std::string constraint;
  std::string
      key;       ///< that set_constraint_properties has for it: bias, motor_position, motor_force
  double value;  ///< of that key
};

inline bool same_motor(const Motor& a, const Motor& b) {
  return a.constraint == b.constraint && a.key == b.key;
}

/// Those of a scene as `save_scene` answers it, at most `most`; none of another text. Throws
/// std::runtime_error where a constraint with a motor cannot be read.
std::vector<Motor> motors_in(const std::string& scene, std::size_t most);

/// The unit of a key, for people.
const char* unit_of(const std::string& key);

}  // namespace constraint_sim::panel
