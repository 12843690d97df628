#include "constraint_sim/scene.h"

#include <limits>

#include "engine/method_names.h"
#include "engine/validate.h"
#include "engine/yaml_element.h"

namespace constraint_sim::engine {
namespace {

[[noreturn]] void fail_unknown(const YamlElement& element, const std::string& word,
                               const std::string& existing) {
  element.fail("there is no " + quoted(word) + " (yet); there are " + existing);
}

WorldOptions read_options(const YamlElement& item, const WorldOptions& defaults) {
  item.expect_keys({"gravity", "time_step", "method", "closing_time", "sleep_after", "sleep_speed",
                    "threads", "order", "tolerance", "stiff_order", "dissipation",
                    "stiffness_limit", "iterations", "warm_starting", "baumgarte"});
  WorldOptions options = defaults;
  item.read("gravity", &options.gravity);
  item.read("time_step", &options.time_step);
  if (const auto method = item.find("method")) {
    const std::string word = method->word();
    options.method = item.attempt([&] { return method_named(word); });
  }
  item.read("order", &options.order);
  item.read("tolerance", &options.tolerance);
  item.read("stiff_order", &options.stiff_order);
  item.read("dissipation", &options.dissipation);
  if (const auto limit = item.find("stiffness_limit"))
    options.stiffness_limit = limit->number_or_infinity();
  item.read("iterations", &options.iterations);
  item.read("warm_starting", &options.warm_starting);
  item.read("baumgarte", &options.baumgarte);
  item.read("closing_time", &options.closing_time);
  if (const auto after = item.find("sleep_after"))
    options.sleep_after = after->number_or_infinity();
  item.read("sleep_speed", &options.sleep_speed);
  item.read("threads", &options.threads);
  item.attempt([&] { validate(options); });
  return options;
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
                    "no_collision"});
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

/// The constraint's own keys beside those that all types have.
YamlElement::Words keys_of_type(const YamlElement& item, const std::string& type) {
  if (type == "distance")
    return {"length",        "min_length", "max_length", "frequency",
            "damping_ratio", "stiffness",  "damping"};
  if (type == "rope") return {"max_length"};
  if (type == "strut") return {"min_length"};
  if (type == "spring") return {"length", "frequency", "damping_ratio", "stiffness", "damping"};
  if (type == "ball") return {};
  fail_unknown(item.at("type"), type, "distance, rope, strut, spring, ball");
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

Motor read_motor(const YamlElement& item) {
  item.expect_keys({"bias", "amplitude", "frequency", "phase", "max_force", "timeout"});
  Motor motor;
  item.read("bias", &motor.bias);
  item.read("amplitude", &motor.amplitude);
  item.read("frequency", &motor.frequency);
  item.read("phase", &motor.phase);
  item.read("max_force", &motor.max_force);
  item.read("timeout", &motor.timeout);
  item.attempt([&] { validate(motor); });
  return motor;
}

Joint read_joint(const YamlElement& item, const World& world) {
  const auto type_element = item.find("type");
  const std::string type = type_element ? type_element->word() : "distance";
  YamlElement::Words keys = keys_of_type(item, type);
  keys.insert(keys.end(), {"name", "type", "body_a", "anchor_a", "body_b", "anchor_b", "motor",
                           "baumgarte", "break_force", "collide_connected", "broken"});
  item.expect_keys(keys);

  Joint joint;
  joint.name = item.at("name").word();
  joint.body_a = read_body_reference(item, "body_a", world);
  item.read("anchor_a", &joint.anchor_a);
  joint.body_b = read_body_reference(item, "body_b", world);
  item.read("anchor_b", &joint.anchor_b);
  if (type == "ball")
    joint.type = BallJoint{};
  else
    joint.type = read_distance(item, type, world, joint);
  if (const auto motor = item.find("motor")) joint.motor = read_motor(*motor);
  if (const auto baumgarte = item.find("baumgarte")) joint.baumgarte = baumgarte->number();
  item.read("break_force", &joint.break_force);
  item.read("collide_connected", &joint.collide_connected);
  return joint;
}

Wrench read_wrench(const YamlElement& item, const World& world) {
  item.expect_keys({"body", "force", "torque", "start", "duration"});
  item.at("body");
  Wrench wrench;
  wrench.body = read_body_reference(item, "body", world);
  item.read("force", &wrench.force);
  item.read("torque", &wrench.torque);
  item.read("start", &wrench.start);
  item.attempt([&] { check_not_negative("start", wrench.start); });
  double duration = std::numeric_limits<double>::infinity();
  item.read("duration", &duration);
  wrench.end = wrench.start + duration;
  if (!(wrench.end > wrench.start))
    item.at("duration")
        .fail("must be > 0 and not lost beside the start, got " + shortest(duration));
  return wrench;
}

std::vector<YamlElement> items_of(const YamlElement& scene, const std::string& key) {
  const auto list = scene.find(key);
  return list ? list->items() : std::vector<YamlElement>{};
}

}  // namespace

World load_scene(const std::string& text, const std::string& source, const WorldOptions& defaults) {
  const YamlElement scene = YamlElement::parse(text, source);
  scene.expect_keys({"world", "bodies", "constraints", "wrenches"});

  const auto options = scene.find("world");
  World world(options ? read_options(*options, defaults) : defaults);

  for (const YamlElement& item : items_of(scene, "bodies")) {
    const Body body = read_body(item);
    item.attempt([&] { world.add_body(body); });
  }
  for (const YamlElement& item : items_of(scene, "constraints")) {
    const Joint joint = read_joint(item, world);
    bool broken = false;
    item.read("broken", &broken);
    item.attempt([&] { world.add_joint(joint, broken); });
  }
  for (const YamlElement& item : items_of(scene, "wrenches")) {
    const Wrench wrench = read_wrench(item, world);
    item.attempt([&] { world.add_wrench(wrench); });
  }
  return world;
}

}  // namespace constraint_sim::engine
