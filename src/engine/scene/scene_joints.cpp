#include "engine/scene/scene_joints.h"

#include "engine/constraints/joint_kinds.h"
#include "engine/math/list.h"
#include "engine/model/validate.h"
#include "engine/world/world_impl.h"

namespace constraint_sim::engine {
namespace {

Eigen::Vector3d in_world(const World& world, BodyId body, const Eigen::Vector3d& anchor) {
  const BodyState& state = world.state(body);
  return state.position + state.orientation * anchor;
}

double present_distance(const World& world, const Joint& joint) {
  return (in_world(world, joint.body_b, joint.anchor_b) -
          in_world(world, joint.body_a, joint.anchor_a))
      .norm();
}

/// Returns the keys of a type of constraint beside the keys of all types.
YamlElement::Words keys_of_type(const YamlElement& item, const std::string& type) {
  if (type == "distance") return keys_of<DistanceJoint>({"free"});
  if (type == "rope") return {"max_length", "frequency", "damping_ratio", "stiffness", "damping"};
  if (type == "strut") return {"min_length"};
  if (type == "spring")
    return {"length", "frequency", "damping_ratio", "stiffness", "damping", "one_sided"};
  const std::optional<JointKind> kind = joint_kind_named(type);
  if (!kind)
    fail_unknown(item.at("type"), type, "distance, rope, strut, spring" + names_of_further_kinds());
  YamlElement::Words keys;
  if (info(*kind).has_frames) keys = {"axis_a", "axis_b", "frame_a", "frame_b"};
  if (info(*kind).coordinates > 0) {
    keys = keys_of<CoordinateLaw>(keys);
    keys.push_back("coordinates");
  }
  if (bears_torque(*kind)) keys.push_back("break_torque");
  if (info(*kind).couples_joints) keys.insert(keys.end(), {"joints", "ratio"});
  if (info(*kind).couples_lengths) keys.push_back("one_sided");
  if (info(*kind).is_custom) keys.insert(keys.end(), {"custom", "parameters"});
  if (info(*kind).has_pitch) keys.push_back("pitch");
  if (info(*kind).couples) keys.push_back("value");
  return keys;
}

/// Reads frames, or their z axes.
void read_frames(const YamlElement& item, Joint* joint) {
  for (const char* side : {"a", "b"}) {
    const auto axis = item.find(std::string("axis_") + side);
    const std::string frame_key = std::string("frame_") + side;
    const auto frame = item.find(frame_key);
    if (axis && frame) axis->fail("the frame already says it; give one or the other");
    if (!axis && !frame) continue;
    const bool is_a = side[0] == 'a';
    if (frame) {
      item.read(frame_key, is_a ? &joint->frame_a : &joint->frame_b.emplace());
      continue;
    }
    const Eigen::Vector3d direction = axis->numbers(3);
    if (is_a)
      item.attempt([&] { joint->frame_a = frame_along(direction); });
    else
      joint->axis_b = direction;
  }
}

/// Reads the distance settings of every type but `ball`, after the anchors.
DistanceJoint read_distance(const YamlElement& item, const std::string& type, const World& world,
                            const Joint& joint) {
  DistanceJoint distance;
  if (type == "rope") distance.max_length = present_distance(world, joint);
  if (type == "strut") distance.min_length = present_distance(world, joint);
  visit_fields(distance, [&](const char* key, auto& value, auto) { item.read(key, &value); });
  if (type == "rope" && distance.is_soft())
    item.attempt([&] { distance = tension_spring(distance); });
  // A strut without a lower limit, or a spring without stiffness, would be a rigid rod.
  if (type == "strut") item.attempt([&] { check_positive("min_length", distance.min_length); });
  if (type == "spring" && !distance.is_soft())
    item.fail("a spring needs a frequency or stiffness > 0");
  return distance;
}

/// Reads a motor with the keys of a list of its fields.
template <class List>
Motor read_motor(const YamlElement& item, const List& list) {
  item.expect_keys(keys_in<Motor>(list));
  Motor motor;
  visit_list(list, motor, [&](const char* key, auto& value, auto) { item.read(key, &value); });
  item.attempt([&] { validate(motor); });
  return motor;
}

CoordinateLaw read_law(const YamlElement& item) {
  CoordinateLaw law;
  visit_fields(law, [&](const char* key, auto& value, auto) {
    if constexpr (std::is_same_v<decltype(value), std::optional<Motor>&>) {
      if (const auto motor = item.find(key)) value = read_coordinate_motor(*motor);
    } else {
      item.read(key, &value);
    }
  });
  if (law.position && item.find("zero"))
    item.at("zero").fail("the position already says it; give one or the other");
  item.attempt([&] { validate(law); });
  return law;
}

/// Reads the laws of the first coordinate, or a list with the laws of all.
void read_laws(const YamlElement& item, Joint* joint) {
  const auto list = item.find("coordinates");
  if (!list) {
    joint->coordinates[0] = read_law(item);
    return;
  }
  const YamlElement::Words keys = keys_of<CoordinateLaw>();
  for (const std::string& key : keys)
    if (const auto flat = item.find(key))
      flat->fail("belongs into the list of coordinates beside it");
  std::size_t i = 0;
  for (const YamlElement& law : list->items()) {
    if (i >= static_cast<std::size_t>(info(joint->kind).coordinates))
      law.fail("a " + std::string(name(joint->kind)) + " joint has only " +
               std::to_string(info(joint->kind).coordinates));
    law.expect_keys(keys);
    joint->coordinates[i++] = read_law(law);
  }
}

/// Returns the type of a constraint; `distance` with `free: true` is free_distance.
std::string type_of_joint(const YamlElement& item) {
  const auto type = item.find("type");
  std::string given = type ? type->word() : "distance";
  const auto free = item.find("free");
  if (given != "distance" || !free || !free->flag()) return given;
  return name(JointKind::kFreeDistance);
}

/// Reads the keys of a gear, a pulley or a screw. Coupled joints must exist already.
void read_coupling(const YamlElement& item, const World& world, Joint* joint) {
  if (info(joint->kind).has_pitch) joint->pitch = item.at("pitch").number();
  item.read("value", &joint->coupling.value);
  if (!info(joint->kind).couples_joints) return;
  const List<YamlElement> names = item.at("joints").items();
  if (names.size() != 2)
    item.at("joints").fail("must be the names of two constraints, got " +
                           std::to_string(names.size()));
  const auto find = [&](const YamlElement& element) {
    const std::string name = element.word();
    if (!world.has_joint(name))
      element.fail("there is no constraint " + in_quotes(name) + " before this one");
    return world.find_joint(name);
  };
  joint->coupling.first = find(names[0]);
  joint->coupling.second = find(names[1]);
  item.read("ratio", &joint->coupling.ratio);
  item.read("one_sided", &joint->coupling.one_sided);
}

/// Reads the type and parameters of a custom constraint or force.
CustomElement read_custom(const YamlElement& item) {
  CustomElement custom;
  custom.type = item.at("custom").word();
  if (const auto parameters = item.find("parameters"))
    for (const std::string& key : parameters->keys())
      custom.parameters.push_back({key, parameters->at(key).number()});
  return custom;
}

/// Reads a number per row and coordinate of a joint, at least three.
void read_rows(const YamlElement& item, const char* key, JointKind kind, RowVector* rows) {
  const int size = std::max(forms(kind).rows + forms(kind).coordinates, 3);
  if (const auto numbers = item.find(key)) rows->head(size) = numbers->numbers(size);
  item.attempt([&] {
    for (int k = 0; k < size; ++k) check_saved(key, (*rows)[k]);
  });
}

/// Reads ends of biases: a list for all coordinates, or one time for the first coordinate or the
/// length.
void read_expiry(const YamlElement& item, int count, JointState* state) {
  if (!item.is_list()) {
    (count > 0 ? state->coordinates[0].expires_at : state->expires_at) = item.number_or_infinity();
    return;
  }
  const List<YamlElement> ends = item.items();
  if (static_cast<int>(ends.size()) != count)
    item.fail("must be one for each coordinate, got " + std::to_string(ends.size()));
  for (std::size_t i = 0; i < ends.size(); ++i)
    state->coordinates[i].expires_at = ends[i].number_or_infinity();
}

/// Reads the motions of coordinates to new positions, one for each coordinate.
void read_moving(const YamlElement& item, int count,
                 std::array<MovingStart, kMaxCoordinates>* moving) {
  const List<YamlElement> starts = item.items();
  if (static_cast<int>(starts.size()) != count)
    item.fail("must be one for each coordinate, got " + std::to_string(starts.size()));
  for (std::size_t i = 0; i < starts.size(); ++i) {
    const Eigen::VectorXd numbers = starts[i].numbers(5);
    for (const double number : numbers) starts[i].attempt([&] { check_saved("moving", number); });
    starts[i].attempt([&] { check_not_negative("moving", numbers[1]); });
    (*moving)[i] = {numbers[0], numbers[1], numbers[2], numbers[3], numbers[4]};
  }
}

}  // namespace

Motor read_coordinate_motor(const YamlElement& item) { return read_motor(item, kFields<Motor>); }

BodyId read_body_reference(const YamlElement& item, const std::string& key, const World& world) {
  const auto reference = item.find(key);
  if (!reference) return kWorldBody;
  const std::string name = reference->word();
  if (name == "world") return kWorldBody;
  if (!world.has_body(name)) reference->fail("there is no body " + in_quotes(name));
  return world.find_body(name);
}

Joint read_joint(const YamlElement& item, const World& world) {
  const std::string type = type_of_joint(item);
  YamlElement::Words keys = keys_of_type(item, type);
  keys.insert(keys.end(), {"name", "type", "baumgarte", "break_force", "collide_connected",
                           "enabled", "broken", "state"});
  // Shorthands such as rope stand for the default kind.
  const JointKind kind = joint_kind_named(type).value_or(Joint{}.kind);
  if (info(kind).is_free_length) keys.push_back("free");
  if (!info(kind).couples_joints)
    keys.insert(keys.end(), {"body_a", "anchor_a", "body_b", "anchor_b", "motor"});
  item.expect_keys(keys);

  Joint joint;
  joint.kind = kind;
  joint.name = item.at("name").word();
  joint.body_a = read_body_reference(item, "body_a", world);
  item.read("anchor_a", &joint.anchor_a);
  joint.body_b = read_body_reference(item, "body_b", world);
  item.read("anchor_b", &joint.anchor_b);
  if (info(kind).couples) read_coupling(item, world, &joint);
  if (has_length(joint.kind)) joint.distance = read_distance(item, type, world, joint);
  if (info(joint.kind).has_frames) read_frames(item, &joint);
  if (info(joint.kind).is_custom) joint.custom = read_custom(item);
  if (info(joint.kind).coordinates > 0)
    read_laws(item, &joint);
  else if (const auto motor = item.find("motor"))
    joint.motor = read_motor(*motor, kVelocityMotor);
  visit_list(kJointSettings, joint,
             [&](const char* key, auto& value, auto) { item.read(key, &value); });
  return joint;
}

SelfStress read_self_stress(const YamlElement& item, JointKind kind) {
  SelfStress self_stress;
  read_rows(item, "self_stress", kind, &self_stress.share);
  read_rows(item, "self_stress_of", kind, &self_stress.impulse);
  return self_stress;
}

/// Reads the state that a saved joint continues from.
JointData read_joint_state(const YamlElement& item, JointKind kind) {
  item.expect_keys({"coupling_constant", "coupling_impulse", "closing_coupling", "travel",
                    "saturated", "expires_at", "impulse", "self_stress", "self_stress_of",
                    "positions", "held", "braking", "closing_since", "closing_offset",
                    "closing_shift", "closing_turn", "closing_share", "moving", "initial_error"});
  JointData state;
  item.read("travel", &state.travel);
  item.read("saturated", &state.saturated);
  read_rows(item, "impulse", kind, &state.impulse);
  item.read("coupling_constant", &state.coupling.constant);
  item.read("coupling_impulse", &state.coupling_impulse);
  item.read("closing_coupling", &state.to_close.coupling);
  const int size = info(kind).coordinates;
  const auto read_coordinates = [&](const char* key, double CoordinateState::*field) {
    if (size == 0) return;
    const Eigen::VectorXd numbers = item.at(key).numbers(size);
    for (int i = 0; i < size; ++i) {
      item.attempt([&] { check_saved(key, numbers[i]); });
      state.coordinates[static_cast<std::size_t>(i)].*field = numbers[i];
    }
  };
  read_coordinates("positions", &CoordinateState::position);
  read_coordinates("held", &CoordinateState::held);
  if (item.find("braking")) read_coordinates("braking", &CoordinateState::braking);
  if (const auto value = item.find("expires_at")) read_expiry(*value, size, &state);
  if (const auto since = item.find("closing_since")) {
    state.closing = true;
    state.to_close.since = since->number();
    item.at("closing_offset");
    read_rows(item, "closing_offset", kind, &state.to_close.offset);
    item.read("closing_shift", &state.to_close.shift);
    item.read("closing_turn", &state.to_close.turn);
    item.read("closing_share", &state.closing_share);
    if (const auto moving = item.find("moving")) read_moving(*moving, size, &state.to_close.moving);
    state.initial_error = item.at("initial_error").number();
  }
  item.attempt([&] {
    check_saved("travel", state.travel);
    check_saved("coupling_constant", state.coupling.constant);
    check_saved("coupling_impulse", state.coupling_impulse);
    check_saved("closing_coupling", state.to_close.coupling);
    if (std::isfinite(state.expires_at)) check_saved("expires_at", state.expires_at);
    check_saved("closing_since", state.to_close.since);
    check_saved("closing_shift", state.to_close.shift);
    check_saved("closing_turn", state.to_close.turn);
    check_saved("closing_share", state.closing_share);
    check_saved("initial_error", state.initial_error);
  });
  return state;
}

}  // namespace constraint_sim::engine
