#include "constraint_sim/engine/scene.h"

#include <limits>

#include "engine/constraints/joint_kinds.h"
#include "engine/method_names.h"
#include "engine/validate.h"
#include "engine/world_impl.h"
#include "engine/yaml_element.h"

namespace constraint_sim::engine {
namespace {

[[noreturn]] void fail_unknown(const YamlElement& element, const std::string& word,
                               const std::string& existing) {
  element.fail("there is no " + quoted(word) + " (yet); there are " + existing);
}

// ---- options

template <class Value, class Range>
void read_option(const YamlElement& item, const char* key, Value* value, Range) {
  item.read(key, value);
}
void read_option(const YamlElement& item, const char* key, double* value, PositiveOrInfinity) {
  if (const auto element = item.find(key)) *value = element->number_or_infinity();
}
void read_option(const YamlElement& item, const char* key, Method* value, AnyValue) {
  const auto element = item.find(key);
  if (!element) return;
  const std::string word = element->word();
  *value = item.attempt([&] { return method_named(word); });
}

WorldOptions read_options(const YamlElement& item, const WorldOptions& defaults) {
  WorldOptions options = defaults;
  YamlElement::Words keys{"clock"};
  visit_options(options, [&](const OptionInfo& info, auto&, auto) { keys.push_back(info.name); });
  item.expect_keys(keys);
  visit_options(options, [&](const OptionInfo& info, auto& value, auto range) {
    read_option(item, info.name, &value, range);
  });
  item.attempt([&] { validate(options); });
  return options;
}

void read_clock(const YamlElement& item, World* world) {
  item.expect_keys({"time", "since", "step"});
  double time = 0.0;
  item.read("time", &time);
  std::uint64_t since = 0;
  if (const auto value = item.find("since")) since = value->count();
  std::uint64_t step = since;
  if (const auto value = item.find("step")) step = value->count();
  if (step < since) item.at("step").fail("must not be below since, got " + std::to_string(step));
  item.attempt([&] { world->set_time(time, since); });
  auto& impl = Insides::of(*world);
  impl.step_count = step;
  item.attempt([&] { check_next_tick("step", world->time(), world->options().time_step); });
}

// ---- bodies

BodyType read_body_type(const YamlElement& item) {
  const std::string word = item.word();
  if (word == "dynamic") return BodyType::kDynamic;
  if (word == "static") return BodyType::kStatic;
  if (word == "kinematic") return BodyType::kKinematic;
  fail_unknown(item, word, "dynamic, static, kinematic");
}

Shape read_shape(const YamlElement& item) {
  const auto kinds = item.keys();
  if (kinds.size() != 1)
    item.fail("expected exactly one shape, got " + std::to_string(kinds.size()));
  const YamlElement parameters = item.at(kinds[0]);
  if (kinds[0] == "point") {
    parameters.expect_keys({});
    return Point{};
  }
  if (kinds[0] == "sphere") {
    parameters.expect_keys({"radius"});
    return Sphere{parameters.at("radius").number()};
  }
  if (kinds[0] == "box") {
    parameters.expect_keys({"size"});
    return Box{parameters.at("size").numbers(3)};
  }
  if (kinds[0] == "plane") {
    parameters.expect_keys({"normal", "offset"});
    return Plane{};
  }
  fail_unknown(item, kinds[0], "point, sphere, box, plane");
}

BodyState read_state(const YamlElement& item) {
  BodyState state;
  item.read("position", &state.position);
  if (const auto orientation = item.find("orientation")) {
    const Eigen::Vector4d xyzw = orientation->numbers(4);
    state.orientation.coeffs() = xyzw;
  }
  item.read("linear_velocity", &state.linear_velocity);
  item.read("angular_velocity", &state.angular_velocity);
  return state;
}

/// Places a body whose plane is given as `normal` and `offset`.
void read_plane_pose(const YamlElement& item, const YamlElement& plane, BodyState* state) {
  if (!plane.find("normal") && !plane.find("offset")) return;
  for (const char* key : {"position", "orientation"}) {
    if (const auto value = item.find(key))
      value->fail("the plane's normal and offset already say where it is; give one or the other");
  }
  Eigen::Vector3d normal = Eigen::Vector3d::UnitZ();
  double offset = 0.0;
  plane.read("normal", &normal);
  plane.read("offset", &offset);
  const double norm = normal.stableNorm();
  if (!(norm > 0.0)) plane.at("normal").fail("must not be zero, got [0, 0, 0]");
  normal /= norm;
  state->position = offset * normal;
  state->orientation = Eigen::Quaterniond::FromTwoVectors(Eigen::Vector3d::UnitZ(), normal);
}

Body read_body(const YamlElement& item) {
  item.expect_keys({"name", "type", "shape", "mass", "inertia", "position", "orientation",
                    "linear_velocity", "angular_velocity", "friction", "restitution",
                    "no_collision", "asleep", "correction"});
  Body body;
  body.name = item.at("name").word();
  if (const auto type = item.find("type")) body.type = read_body_type(*type);
  item.read("mass", &body.mass);
  item.read("inertia", &body.inertia);
  body.state = read_state(item);
  if (const auto shape = item.find("shape")) {
    body.shape = read_shape(*shape);
    const YamlElement parameters = shape->at(shape->keys()[0]);
    parameters.attempt([&] { validate(body.shape); }, "shape.");
    if (std::holds_alternative<Plane>(body.shape)) read_plane_pose(item, parameters, &body.state);
  }
  item.read("friction", &body.friction);
  item.read("restitution", &body.restitution);
  item.read("no_collision", &body.no_collision);
  return body;
}

// ---- constraints

BodyId read_body_reference(const YamlElement& item, const std::string& key, const World& world) {
  const auto reference = item.find(key);
  if (!reference) return kWorldBody;
  const std::string name = reference->word();
  if (name == "world") return kWorldBody;
  if (!world.has_body(name)) reference->fail("there is no body " + quoted(name));
  return world.find_body(name);
}

Eigen::Vector3d in_world(const World& world, BodyId body, const Eigen::Vector3d& anchor) {
  const BodyState& state = world.state(body);
  return state.position + state.orientation * anchor;
}

double present_distance(const World& world, const Joint& joint) {
  return (in_world(world, joint.body_b, joint.anchor_b) -
          in_world(world, joint.body_a, joint.anchor_a))
      .norm();
}

const YamlElement::Words kLawKeys{"position",  "lower",         "upper",     "limit_restitution",
                                  "friction",  "damping",       "stiffness", "rest",
                                  "frequency", "damping_ratio", "zero"};

/// The constraint's own keys beside those that all types have.
YamlElement::Words keys_of_type(const YamlElement& item, const std::string& type) {
  if (type == "distance")
    return {"length",        "min_length", "max_length", "frequency",
            "damping_ratio", "stiffness",  "damping",    "free"};
  if (type == "rope") return {"max_length"};
  if (type == "strut") return {"min_length"};
  if (type == "spring") return {"length", "frequency", "damping_ratio", "stiffness", "damping"};
  const std::optional<JointKind> kind = joint_kind_named(type);
  if (!kind)
    fail_unknown(item.at("type"), type, "distance, rope, strut, spring" + names_of_further_kinds());
  YamlElement::Words keys;
  if (has_frames(*kind)) keys = {"axis_a", "axis_b", "frame_a", "frame_b"};
  if (coordinates(*kind) > 0) {
    keys.insert(keys.end(), kLawKeys.begin(), kLawKeys.end());
    keys.push_back("coordinates");
  }
  if (has_frames(*kind) || info(*kind).form == RowsForm::kPoint) keys.push_back("break_torque");
  if (couples_joints(*kind)) keys.insert(keys.end(), {"joints", "ratio"});
  if (has_pitch(*kind)) keys.push_back("pitch");
  if (couples(*kind)) keys.push_back("value");
  return keys;
}

Eigen::Quaterniond read_frame(const YamlElement& item) {
  Eigen::Quaterniond frame;
  frame.coeffs() = Eigen::Vector4d(item.numbers(4));
  return frame;
}

/// Frames, or the z axes of these.
void read_frames(const YamlElement& item, Joint* joint) {
  for (const char* side : {"a", "b"}) {
    const auto axis = item.find(std::string("axis_") + side);
    const auto frame = item.find(std::string("frame_") + side);
    if (axis && frame) axis->fail("the frame already says it; give one or the other");
    if (!axis && !frame) continue;
    const bool is_a = side[0] == 'a';
    if (frame) {
      (is_a ? joint->frame_a : joint->frame_b.emplace()) = read_frame(*frame);
      continue;
    }
    const Eigen::Vector3d direction = axis->numbers(3);
    if (is_a)
      item.attempt([&] { joint->frame_a = frame_along(direction); });
    else
      joint->axis_b = direction;
  }
}

/// Reads distances and springs of every type but `ball`; anchors have been read.
DistanceJoint read_distance(const YamlElement& item, const std::string& type, const World& world,
                            const Joint& joint) {
  DistanceJoint distance;
  if (type == "rope") distance.max_length = present_distance(world, joint);
  if (type == "strut") distance.min_length = present_distance(world, joint);
  if (const auto length = item.find("length")) distance.length = length->number();
  item.read("min_length", &distance.min_length);
  item.read("max_length", &distance.max_length);
  item.read("frequency", &distance.frequency);
  item.read("damping_ratio", &distance.damping_ratio);
  item.read("stiffness", &distance.stiffness);
  item.read("damping", &distance.damping);
  // a strut without a least length, or a spring without stiffness, would pass for a rigid rod
  if (type == "strut") item.attempt([&] { check_positive("min_length", distance.min_length); });
  if (type == "spring" && !distance.is_soft())
    item.fail("a spring needs a frequency or stiffness > 0");
  return distance;
}

const YamlElement::Words kMotorKeys{"bias",  "amplitude", "frequency",
                                    "phase", "max_force", "timeout"};

void read_bias(const YamlElement& item, Motor* motor) {
  item.read("bias", &motor->bias);
  item.read("amplitude", &motor->amplitude);
  item.read("frequency", &motor->frequency);
  item.read("phase", &motor->phase);
  item.read("max_force", &motor->max_force);
  item.read("timeout", &motor->timeout);
}

Motor read_motor(const YamlElement& item) {
  item.expect_keys(kMotorKeys);
  Motor motor;
  read_bias(item, &motor);
  item.attempt([&] { validate(motor); });
  return motor;
}

CoordinateMotor read_coordinate_motor(const YamlElement& item) {
  YamlElement::Words keys = kMotorKeys;
  keys.insert(keys.end(), {"position", "servo_frequency", "servo_damping_ratio", "servo_stiffness",
                           "servo_damping", "force"});
  item.expect_keys(keys);
  CoordinateMotor motor;
  read_bias(item, &motor);
  if (const auto position = item.find("position")) motor.position = position->number();
  item.read("servo_frequency", &motor.servo_frequency);
  item.read("servo_damping_ratio", &motor.servo_damping_ratio);
  item.read("servo_stiffness", &motor.servo_stiffness);
  item.read("servo_damping", &motor.servo_damping);
  if (const auto force = item.find("force")) motor.force = force->number();
  item.attempt([&] { validate(motor); });
  return motor;
}

CoordinateLaw read_law(const YamlElement& item) {
  CoordinateLaw law;
  if (const auto motor = item.find("motor")) law.motor = read_coordinate_motor(*motor);
  if (const auto lower = item.find("lower")) law.lower = lower->number();
  if (const auto upper = item.find("upper")) law.upper = upper->number();
  item.read("limit_restitution", &law.limit_restitution);
  item.read("friction", &law.friction);
  item.read("damping", &law.damping);
  item.read("stiffness", &law.stiffness);
  item.read("rest", &law.rest);
  item.read("frequency", &law.frequency);
  item.read("damping_ratio", &law.damping_ratio);
  if (const auto position = item.find("position")) law.position = position->number();
  item.read("zero", &law.zero);
  if (law.position && item.find("zero"))
    item.at("zero").fail("the position already says it; give one or the other");
  item.attempt([&] { validate(law); });
  return law;
}

/// Laws of the first coordinate, or of all in a list.
void read_laws(const YamlElement& item, Joint* joint) {
  const auto list = item.find("coordinates");
  if (!list) {
    joint->coordinates[0] = read_law(item);
    return;
  }
  YamlElement::Words keys = kLawKeys;
  keys.push_back("motor");
  for (const std::string& key : keys)
    if (const auto flat = item.find(key))
      flat->fail("belongs into the list of coordinates beside it");
  std::size_t i = 0;
  for (const YamlElement& law : list->items()) {
    if (i >= static_cast<std::size_t>(coordinates(joint->kind)))
      law.fail("a " + std::string(name(joint->kind)) + " joint has only " +
               std::to_string(coordinates(joint->kind)));
    law.expect_keys(keys);
    joint->coordinates[i++] = read_law(law);
  }
}

/// `distance` with `free: true` is a kind of its own.
std::string type_of_joint(const YamlElement& item) {
  const auto type = item.find("type");
  std::string given = type ? type->word() : "distance";
  const auto free = item.find("free");
  if (given != "distance" || !free || !free->flag()) return given;
  return name(free_length());
}

/// What a gear, a pulley or a screw has beside the keys of all. Joints have to be there already.
void read_coupling(const YamlElement& item, const World& world, Joint* joint) {
  if (has_pitch(joint->kind)) joint->pitch = item.at("pitch").number();
  if (const auto value = item.find("value")) joint->coupling.value = value->number();
  if (!couples_joints(joint->kind)) return;
  const std::vector<YamlElement> names = item.at("joints").items();
  if (names.size() != 2)
    item.at("joints").fail("must be the names of two constraints, got " +
                           std::to_string(names.size()));
  const auto find = [&](const YamlElement& element) {
    const std::string name = element.word();
    if (!world.has_joint(name))
      element.fail("there is no constraint " + quoted(name) + " before this one");
    return world.find_joint(name);
  };
  joint->coupling.first = find(names[0]);
  joint->coupling.second = find(names[1]);
  item.read("ratio", &joint->coupling.ratio);
}

Joint read_joint(const YamlElement& item, const World& world) {
  const std::string type = type_of_joint(item);
  YamlElement::Words keys = keys_of_type(item, type);
  keys.insert(keys.end(), {"name", "type", "baumgarte", "break_force", "collide_connected",
                           "enabled", "broken", "state"});
  const JointKind kind = joint_kind_named(type).value_or(Joint{}.kind);  // or a shorthand
  if (is_free_length(kind)) keys.push_back("free");
  if (!couples_joints(kind))
    keys.insert(keys.end(), {"body_a", "anchor_a", "body_b", "anchor_b", "motor"});
  item.expect_keys(keys);

  Joint joint;
  joint.kind = kind;
  joint.name = item.at("name").word();
  joint.body_a = read_body_reference(item, "body_a", world);
  item.read("anchor_a", &joint.anchor_a);
  joint.body_b = read_body_reference(item, "body_b", world);
  item.read("anchor_b", &joint.anchor_b);
  if (couples(kind)) read_coupling(item, world, &joint);
  if (if_distance(joint) != nullptr) joint.distance = read_distance(item, type, world, joint);
  if (has_frames(joint.kind)) read_frames(item, &joint);
  if (coordinates(joint.kind) > 0)
    read_laws(item, &joint);
  else if (const auto motor = item.find("motor"))
    joint.motor = read_motor(*motor);
  if (const auto baumgarte = item.find("baumgarte")) joint.baumgarte = baumgarte->number();
  item.read("break_force", &joint.break_force);
  item.read("break_torque", &joint.break_torque);
  item.read("collide_connected", &joint.collide_connected);
  item.read("enabled", &joint.enabled);
  return joint;
}

/// The numbers of a joint's rows, at least three.
void read_rows(const YamlElement& item, const char* key, JointKind kind, RowVector* rows) {
  const int size = std::max(info(kind).rows + info(kind).coordinates, 3);
  if (const auto numbers = item.find(key)) rows->head(size) = numbers->numbers(size);
  item.attempt([&] {
    for (int k = 0; k < size; ++k) check_finite(key, (*rows)[k]);
  });
}

SelfStress read_self_stress(const YamlElement& item, JointKind kind) {
  SelfStress self_stress;
  read_rows(item, "self_stress", kind, &self_stress.share);
  read_rows(item, "self_stress_of", kind, &self_stress.impulse);
  return self_stress;
}

/// When biases end: of each coordinate in a list; of the first, or of the length, one time.
void read_expiry(const YamlElement& item, int count, JointState* state) {
  if (!item.is_list()) {
    (count > 0 ? state->coordinates[0].expires_at : state->expires_at) = item.number_or_infinity();
    return;
  }
  const std::vector<YamlElement> ends = item.items();
  if (static_cast<int>(ends.size()) != count)
    item.fail("must be one for each coordinate, got " + std::to_string(ends.size()));
  for (std::size_t i = 0; i < ends.size(); ++i)
    state->coordinates[i].expires_at = ends[i].number_or_infinity();
}

/// State that a saved joint continues from.
JointState read_joint_state(const YamlElement& item, JointKind kind) {
  item.expect_keys({"coupling_constant", "coupling_impulse", "closing_coupling", "travel",
                    "expires_at", "impulse", "self_stress", "self_stress_of", "positions", "held",
                    "closing_since", "closing_offset", "closing_shift", "closing_turn",
                    "closing_share", "initial_error"});
  JointState state;
  item.read("travel", &state.travel);
  read_rows(item, "impulse", kind, &state.impulse);
  item.read("coupling_constant", &state.coupling.constant);
  item.read("coupling_impulse", &state.coupling.impulse);
  item.read("closing_coupling", &state.coupling.offset);
  const int size = coordinates(kind);
  const auto read_coordinates = [&](const char* key, double CoordinateState::*field) {
    if (size == 0) return;
    const Eigen::VectorXd numbers = item.at(key).numbers(size);
    for (int i = 0; i < size; ++i) {
      item.attempt([&] { check_finite(key, numbers[i]); });
      state.coordinates[static_cast<std::size_t>(i)].*field = numbers[i];
    }
  };
  read_coordinates("positions", &CoordinateState::position);
  read_coordinates("held", &CoordinateState::held);
  if (const auto value = item.find("expires_at")) read_expiry(*value, size, &state);
  if (const auto since = item.find("closing_since")) {
    state.closing = true;
    state.closing_since = since->number();
    item.at("closing_offset");
    read_rows(item, "closing_offset", kind, &state.closing_offset);
    item.read("closing_shift", &state.closing_shift);
    item.read("closing_turn", &state.closing_turn);
    item.read("closing_share", &state.closing_share);
    state.initial_error = item.at("initial_error").number();
  }
  item.attempt([&] {
    check_finite("travel", state.travel);
    check_finite("coupling_constant", state.coupling.constant);
    check_finite("coupling_impulse", state.coupling.impulse);
    check_finite("closing_coupling", state.coupling.offset);
    if (std::isfinite(state.expires_at)) check_finite("expires_at", state.expires_at);
    check_finite("closing_since", state.closing_since);
    check_finite("initial_error", state.initial_error);
  });
  return state;
}

Wrench read_wrench(const YamlElement& item, const World& world) {
  item.expect_keys({"body", "force", "torque", "start", "duration", "end"});
  item.at("body");
  Wrench wrench;
  wrench.body = read_body_reference(item, "body", world);
  item.read("force", &wrench.force);
  item.read("torque", &wrench.torque);
  item.read("start", &wrench.start);
  item.attempt([&] {
    if (world.time() >= 0.0) check_not_negative("start", wrench.start);
  });
  if (const auto end = item.find("end")) {
    if (const auto duration = item.find("duration"))
      duration->fail("the end already says it; give one or the other");
    wrench.end = end->number();
    return wrench;
  }
  double duration = std::numeric_limits<double>::infinity();
  item.read("duration", &duration);
  wrench.end = wrench.start + duration;
  if (!(wrench.end > wrench.start))
    item.at("duration")
        .fail("must be > 0 and not lost beside the start, got " + shortest(duration));
  return wrench;
}

// ---- what a saved scene continues from

TouchingPair read_contact(const YamlElement& item, const World& world) {
  item.expect_keys({"body_a", "body_b", "normal", "points"});
  TouchingPair pair;
  pair.id_a = read_body_reference(item, "body_a", world);
  pair.id_b = read_body_reference(item, "body_b", world);
  for (const char* key : {"body_a", "body_b"})
    if (world.body(key[5] == 'a' ? pair.id_a : pair.id_b).no_collision)
      item.fail(std::string(key) + " touches nothing");
  item.read("normal", &pair.manifold.normal);
  item.attempt([&] {
    const Eigen::Vector3d& normal = pair.manifold.normal;
    if (!(std::abs(normal.norm() - 1.0) <= 0.01))
      refuse("normal", "must be a unit vector, got " + shown(normal));
  });
  const std::vector<YamlElement> points = item.at("points").items();
  if (points.empty() || points.size() > pair.manifold.points.size())
    item.at("points").fail("must be 1 to 8, got " + std::to_string(points.size()));
  for (const YamlElement& element : points) {
    element.expect_keys({"feature", "position", "depth", "impulse"});
    const auto k = static_cast<std::size_t>(pair.manifold.count++);
    Manifold::Point& point = pair.manifold.points[k];
    const std::uint64_t feature = element.at("feature").count();
    if (feature > std::numeric_limits<std::uint32_t>::max())
      element.at("feature").fail("is none, got " + std::to_string(feature));
    point.feature = static_cast<std::uint32_t>(feature);
    element.read("position", &point.position);
    element.read("depth", &point.depth);
    element.read("impulse", &pair.impulses[k]);
    element.attempt([&] {
      check_finite("position", point.position);
      check_finite("depth", point.depth);
      check_finite("impulse", pair.impulses[k]);
    });
  }
  return pair;
}

IslandMemory read_island(const YamlElement& item) {
  item.expect_keys({"first_body", "quiet_for", "is_stiff", "stiff_ticks", "stiff_until",
                    "refused_until", "touched_until", "inconsistent_until", "gradient_iterations",
                    "substep_cost"});
  const auto read = [&](const char* key, std::uint64_t* target) {
    if (const auto value = item.find(key)) *target = value->count();
  };
  IslandMemory memory;
  read("quiet_for", &memory.quiet_for);
  item.read("is_stiff", &memory.is_stiff);
  item.read("stiff_ticks", &memory.stiff_ticks);
  item.attempt([&] { check_not_negative("stiff_ticks", memory.stiff_ticks); });
  read("stiff_until", &memory.stiff_until);
  read("refused_until", &memory.refused_until);
  read("touched_until", &memory.touched_until);
  read("inconsistent_until", &memory.inconsistent_until);
  std::uint64_t iterations = 0;
  read("gradient_iterations", &iterations);
  memory.gradient_iterations =
      static_cast<std::uint32_t>(std::min<std::uint64_t>(iterations, 1u << 30));
  item.read("substep_cost", &memory.substep_cost);
  item.attempt([&] { check_not_negative("substep_cost", memory.substep_cost); });
  return memory;
}

std::vector<YamlElement> items_of(const YamlElement& scene, const std::string& key) {
  const auto list = scene.find(key);
  return list ? list->items() : std::vector<YamlElement>{};
}

/// Whether a body slept when the scene was saved.
bool read_asleep(const YamlElement& item, const Body& body) {
  bool asleep = false;
  item.read("asleep", &asleep);
  const bool can_sleep = body.type == BodyType::kDynamic &&
                         body.state.linear_velocity.isZero(0.0) &&
                         body.state.angular_velocity.isZero(0.0);
  if (asleep && !can_sleep) item.at("asleep").fail("a body that moves or is fixed does not sleep");
  return asleep;
}

void continue_from_saved(const YamlElement& scene, const std::vector<BodyId>& asleep,
                         World* world) {
  auto& impl = Insides::of(*world);
  impl.continue_asleep(asleep);
  for (const YamlElement& item : items_of(scene, "contacts")) {
    const TouchingPair pair = read_contact(item, *world);
    item.attempt([&] { impl.continue_contact(pair); });
  }
  for (const YamlElement& item : items_of(scene, "islands")) {
    const IslandMemory memory = read_island(item);
    item.at("first_body");
    impl.loaded_memory.emplace_back(read_body_reference(item, "first_body", *world), memory);
  }
}

}  // namespace

World load_scene(const std::string& text, const std::string& source, const WorldOptions& defaults) {
  const YamlElement scene = YamlElement::parse(text, source);
  scene.expect_keys({"world", "bodies", "constraints", "wrenches", "contacts", "islands"});

  const auto options = scene.find("world");
  World world(options ? read_options(*options, defaults) : defaults);

  if (options)
    if (const auto clock = options->find("clock")) read_clock(*clock, &world);

  std::vector<BodyId> asleep;
  for (const YamlElement& item : items_of(scene, "bodies")) {
    const Body body = read_body(item);
    const BodyId id = item.attempt([&] { return world.add_body(body); });
    if (read_asleep(item, body)) asleep.push_back(id);
  }
  for (const YamlElement& item : items_of(scene, "constraints")) {
    const Joint joint = read_joint(item, world);
    bool broken = false;
    item.read("broken", &broken);
    const auto state = item.find("state");
    auto& impl = Insides::of(world);
    const JointId id = item.attempt([&] { return impl.add_joint(joint, broken); });
    if (state) {
      impl.continue_joint(impl.index(id), read_joint_state(*state, joint.kind));
      impl.self_stress[impl.index(id)] = read_self_stress(*state, joint.kind);
    }
  }
  for (const YamlElement& item : items_of(scene, "wrenches")) {
    const Wrench wrench = read_wrench(item, world);
    item.attempt([&] { world.add_wrench(wrench); });
  }
  continue_from_saved(scene, asleep, &world);
  for (const YamlElement& item : items_of(scene, "bodies")) {
    const auto correction = item.find("correction");
    if (!correction) continue;
    auto& impl = Insides::of(world);
    const std::size_t i = impl.index(world.find_body(item.at("name").word()));
    const Twist value = correction->numbers(6);
    item.attempt([&] { impl.continue_correction(i, value); });
  }
  return world;
}

}  // namespace constraint_sim::engine
