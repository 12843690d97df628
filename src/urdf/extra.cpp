#include "urdf/extra.h"

#include <stdexcept>

#include "engine/model/validate.h"
#include "urdf/positions.h"

namespace constraint_sim {
namespace {

using engine::YamlElement;

LinkProperties read_link(const YamlElement& item) {
  item.expect_keys({"friction", "restitution", "no_collision", "convex_parts"});
  LinkProperties link;
  item.read("friction", &link.friction);
  item.read("restitution", &link.restitution);
  item.read("no_collision", &link.no_collision);
  int parts = static_cast<int>(kMostMeshParts);
  item.read("convex_parts", &parts);
  if (parts < 1 || parts > static_cast<int>(kMostMeshParts))
    item.at("convex_parts")
        .fail("must be 1 to " + std::to_string(kMostMeshParts) + ", got " + std::to_string(parts));
  link.convex_parts = static_cast<std::size_t>(parts);
  item.attempt([&] {
    engine::check_not_negative("friction", link.friction);
    engine::check_share("restitution", link.restitution);
  });
  return link;
}

[[noreturn]] void refuse_extra(const std::string& key, const std::string& why) {
  throw std::invalid_argument("extra: " + key + ": " + why);
}

void check_joint_of(const std::string& key, const std::string& name,
                    const urdf::ModelInterface& model) {
  const auto joint = model.getJoint(name);
  if (!joint) refuse_extra(key, "the URDF has no joint '" + name + "'");
  if (!has_position(*joint))
    refuse_extra(key, "joint '" + name + "' is not revolute, continuous or prismatic");
}

void check_link_of(const std::string& key, const std::string& name,
                   const urdf::ModelInterface& model) {
  if (!model.getLink(name)) refuse_extra(key, "the URDF has no link '" + name + "'");
}

std::pair<std::string, std::string> read_pair(const YamlElement& item) {
  const auto links = item.items();
  if (links.size() != 2) item.fail("must be the names of two links");
  return {links[0].word(), links[1].word()};
}

/// Calls do_with(name, value) for each key of an optional map.
template <class Do>
void for_each(const YamlElement& item, const char* key, Do do_with) {
  const auto map = item.find(key);
  if (!map) return;
  for (const std::string& name : map->keys()) do_with(name, map->at(name));
}

}  // namespace

std::map<std::string, std::size_t> most_parts(const RobotExtra& extra) {
  std::map<std::string, std::size_t> most;
  for (const auto& [link, properties] : extra.links) most[link] = properties.convex_parts;
  return most;
}

RobotExtra read_extra(const std::string& text) {
  RobotExtra extra;
  if (text.empty()) return extra;
  const YamlElement document = YamlElement::parse(text, "extra");
  document.expect_keys({"positions", "motors", "hold", "gravity_compensation", "links",
                        "constraints", "no_contact"});
  for_each(document, "positions", [&](const std::string& joint, const YamlElement& value) {
    extra.positions[joint] = value.number();
  });
  for_each(document, "motors", [&](const std::string& joint, const YamlElement& motor) {
    extra.motors.emplace(joint, motor);
  });
  document.read("hold", &extra.hold);
  document.read("gravity_compensation", &extra.gravity_compensation);
  document.attempt(
      [&] { engine::check_share("gravity_compensation", extra.gravity_compensation); });
  for_each(document, "links", [&](const std::string& link, const YamlElement& properties) {
    extra.links[link] = read_link(properties);
  });
  if (const auto list = document.find("constraints")) extra.constraints = list->items();
  if (const auto list = document.find("no_contact"))
    for (const YamlElement& pair : list->items()) extra.no_contact.push_back(read_pair(pair));
  return extra;
}

void check_extra(const RobotExtra& extra, const urdf::ModelInterface& model) {
  for (const auto& entry : extra.positions) check_joint_of("positions", entry.first, model);
  for (const auto& entry : extra.motors) check_joint_of("motors", entry.first, model);
  for (const auto& entry : extra.links) check_link_of("links", entry.first, model);
  for (const auto& [first, second] : extra.no_contact) {
    check_link_of("no_contact", first, model);
    check_link_of("no_contact", second, model);
  }
}

}  // namespace constraint_sim
