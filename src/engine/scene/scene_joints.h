#pragma once

#include <string>

#include "constraint_sim/engine/world.h"
#include "engine/model/state.h"
#include "engine/model/validate.h"
#include "engine/scene/yaml_element.h"

namespace constraint_sim::engine {

// What scene files say of constraints, for scene.cpp.

/// Fails at an element with a word that is none of those that exist.
[[noreturn]] inline void fail_unknown(const YamlElement& element, const std::string& word,
                                      const std::string& existing) {
  element.fail("there is no " + in_quotes(word) + " (yet); there are " + existing);
}

/// The body that a key names; the world where it is left out.
BodyId read_body_reference(const YamlElement& item, const std::string& key, const World& world);

/// `motor` of a free coordinate.
CoordinateMotor read_coordinate_motor(const YamlElement& item);

/// Its bodies, and joints that it couples, have to be there already.
Joint read_joint(const YamlElement& item, const World& world);

/// What a saved joint continues from.
JointState read_joint_state(const YamlElement& item, JointKind kind);
SelfStress read_self_stress(const YamlElement& item, JointKind kind);

}  // namespace constraint_sim::engine
