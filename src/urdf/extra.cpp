#include "urdf/extra.h"

#include "engine/model/validate.h"

namespace constraint_sim {
namespace {

using engine::YamlElement;

LinkProperties read_link(const YamlElement& item) {
  item.expect_keys({"friction", "restitution", "no_collision"});
  LinkProperties link;
  item.read("friction", &link.friction);
  item.read("restitution", &link.restitution);
  item.read("no_collision", &link.no_collision);
  item.attempt([&] {
    engine::check_not_negative("friction", link.friction);
    engine::check_share("restitution", link.restitution);
  });
  return link;
}

/// Calls do_with(name, value) for each key of an optional map.
template <class Do>
void for_each(const YamlElement& item, const char* key, Do do_with) {
  const auto map = item.find(key);
  if (!map) return;
  for (const std::string& name : map->keys()) do_with(name, map->at(name));
}

}  // namespace

RobotExtra read_extra(const std::string& text) {
  RobotExtra extra;
  if (text.empty()) return extra;
  const YamlElement document = YamlElement::parse(text, "extra");
  document.expect_keys({"positions", "motors", "links", "constraints"});
  for_each(document, "positions", [&](const std::string& joint, const YamlElement& value) {
    extra.positions[joint] = value.number();
  });
  for_each(document, "motors", [&](const std::string& joint, const YamlElement& motor) {
    extra.motors.emplace(joint, motor);
  });
  for_each(document, "links", [&](const std::string& link, const YamlElement& properties) {
    extra.links[link] = read_link(properties);
  });
  if (const auto list = document.find("constraints")) extra.constraints = list->items();
  return extra;
}

}  // namespace constraint_sim
