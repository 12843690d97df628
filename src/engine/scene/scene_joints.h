#pragma once

#include <string>
#include <utility>

#include "constraint_sim/engine/world.h"
#include "engine/model/fields.h"
#include "engine/model/state.h"
#include "engine/model/validate.h"
#include "engine/scene/yaml_element.h"

namespace constraint_sim::engine {

// Constraints of scene files, for scene.cpp.

/// Fails at an element with an unknown word, with the words that exist.
[[noreturn]] inline void fail_unknown(const YamlElement& element, const std::string& word,
                                      const std::string& existing) {
  element.fail("there is no " + in_quotes(word) + "; there are " + existing);
}

/// Returns `further` keys and the keys of a list of fields of a struct.
template <class Struct, class List>
YamlElement::Words keys_in(const List& list, YamlElement::Words further = {}) {
  const Struct none{};
  visit_list(list, none, [&](const char* key, const auto&, auto) { further.push_back(key); });
  return further;
}
/// Returns `further` keys and the keys of a struct.
template <class Struct>
YamlElement::Words keys_of(YamlElement::Words further = {}) {
  return keys_in<Struct>(kFields<Struct>, std::move(further));
}

/// Returns the body named by a key; the world where the key is left out.
BodyId read_body_reference(const YamlElement& item, const std::string& key, const World& world);

/// Reads `motor` of a free coordinate.
Motor read_coordinate_motor(const YamlElement& item);

/// Reads a constraint. Its bodies and coupled joints must exist already.
Joint read_joint(const YamlElement& item, const World& world);

/// Read the state that a saved joint continues from.
JointData read_joint_state(const YamlElement& item, JointKind kind);
SelfStress read_self_stress(const YamlElement& item, JointKind kind);

}  // namespace constraint_sim::engine
