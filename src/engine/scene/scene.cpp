#include "constraint_sim/engine/scene.h"

#include <algorithm>
#include <limits>
#include <memory>
#include <utility>
#include <vector>

#include "engine/edits/saved_state.h"
#include "engine/islands/motion_bounds.h"
#include "engine/math/elementary.h"
#include "engine/math/list.h"
#include "engine/math/numbers.h"
#include "engine/model/method_names.h"
#include "engine/model/shape_names.h"
#include "engine/model/validate.h"
#include "engine/scene/scene_joints.h"
#include "engine/scene/yaml_element.h"
#include "engine/world/world_impl.h"

namespace constraint_sim::engine {
namespace {

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

WorldOptions read_options(const YamlElement& item, const WorldOptions& defaults,
                          YamlElement::Words keys = {}) {
  WorldOptions options = defaults;
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
  auto& impl = ImplAccess::of(*world);
  impl.step_count = step;
  item.attempt([&] {
    check_finite("step", world->time());
    check_next_tick("step", world->time(), world->options().time_step);
  });
}

// ---- bodies

/// Returns the only key of a shape, its name, and the element of its dimensions.
std::pair<std::string, YamlElement> kind_of_shape(const YamlElement& item) {
  const auto kinds = item.keys();
  if (kinds.size() != 1)
    item.fail("expected exactly one shape, got " + std::to_string(kinds.size()));
  return {kinds[0], item.at(kinds[0])};
}

// Read a dimension of a shape; its key must exist.
template <class Value>
void read_dimension(const YamlElement& dimensions, const char* key, Value* value) {
  dimensions.at(key).read(value);
}
void read_dimension(const YamlElement& dimensions, const char* key,
                    std::shared_ptr<const ConvexHull>* surface) {
  std::vector<Eigen::Vector3d> vertices;
  for (const YamlElement& vertex : dimensions.at(key).items())
    vertices.emplace_back(vertex.numbers(3));
  *surface = dimensions.attempt([&] { return std::make_shared<const ConvexHull>(vertices); });
}

void read_dimension(const YamlElement& dimensions, const char*,
                    std::shared_ptr<const Compound::Parts>*) {
  dimensions.fail("several shapes are a list 'shapes' of the body");
}

Shape read_shape(const YamlElement& item) {
  const auto [kind, dimensions] = kind_of_shape(item);
  const auto* const name = std::find(kShapeNames.begin(), kShapeNames.end(), kind);
  if (name == kShapeNames.end()) fail_unknown(item, kind, names_of_shapes());
  Shape shape = shape_of_kind(static_cast<std::size_t>(name - kShapeNames.begin()));
  std::visit(
      [&, &dimensions = dimensions](auto& of_kind) {
        using Kind = std::decay_t<decltype(of_kind)>;
        const bool is_plane = std::is_same_v<Kind, Plane>;
        dimensions.expect_keys(is_plane ? YamlElement::Words{"normal", "offset"} : keys_of<Kind>());
        visit_fields(of_kind, [&](const char* key, auto& size, auto) {
          read_dimension(dimensions, key, &size);
        });
      },
      shape);
  dimensions.attempt([&] { validate(shape); }, "shape.");
  return shape;
}

/// Sets the pose of a body from `normal` and `offset` of its plane.
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
  const double norm = math::hypot(normal.x(), normal.y(), normal.z());
  if (!(norm > 0.0)) plane.at("normal").fail("must not be zero, got [0, 0, 0]");
  normal /= norm;
  state->position = offset * normal;
  state->orientation = frame_along(normal);
}

// Read a field of a body, which keeps its value without the key.
template <class Value>
void read(const YamlElement& item, const char* key, Value* value) {
  item.read(key, value);
}
void read(const YamlElement& item, const char* key, std::string* name) {
  *name = item.at(key).word();
}
void read(const YamlElement& item, const char* key, BodyType* type) {
  const auto value = item.find(key);
  if (!value) return;
  const std::string word = value->word();
  const auto* const name = std::find(kBodyTypeNames.begin(), kBodyTypeNames.end(), word);
  if (name == kBodyTypeNames.end()) fail_unknown(*value, word, "dynamic, static, kinematic");
  *type = static_cast<BodyType>(name - kBodyTypeNames.begin());
}
Compound read_shapes(const YamlElement& body);

void read(const YamlElement& item, const char* key, Shape* shape) {
  const auto value = item.find(key), shapes = item.find("shapes");
  if (value && shapes) shapes->fail("the body has a 'shape' already; give one or the other");
  if (value) *shape = read_shape(*value);
  if (shapes) *shape = read_shapes(item);
}
void read(const YamlElement& item, const char* key, std::optional<ShapePose>* pose) {
  const auto value = item.find(key);
  if (!value) return;
  value->expect_keys(keys_of<ShapePose>());
  visit_fields(pose->emplace(),
               [&](const char* part, auto& target, auto) { value->read(part, &target); });
  value->attempt([&] { validate(**pose); });
}
void read(const YamlElement& item, const char* key, std::optional<std::array<double, 4>>* color) {
  if (const auto value = item.find(key))
    Eigen::Map<Eigen::Vector4d>(color->emplace().data()) = value->numbers(4);
}

Compound read_shapes(const YamlElement& body) {
  Compound::Parts parts;
  for (const YamlElement& item : body.at("shapes").items()) {
    item.expect_keys(keys_of<ShapePart>());
    ShapePart& part = parts.emplace_back();
    part.shape = read_shape(item.at("shape"));
    std::optional<ShapePose> pose;
    read(item, "shape_pose", &pose);
    part.pose = pose.value_or(ShapePose{});
    item.read("friction", &part.friction);
    item.read("restitution", &part.restitution);
  }
  return body.attempt([&] { return Compound(std::move(parts)); });
}

Body read_body(const YamlElement& item) {
  item.expect_keys(keys_of<Body>({"asleep", "correction", "shapes"}));
  Body body;
  visit_fields(body, [&](const char* key, auto& value, auto) { read(item, key, &value); });
  if (std::holds_alternative<Plane>(body.shape))
    read_plane_pose(item, kind_of_shape(item.at("shape")).second, &body.state);
  return body;
}

// ---- wrenches

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
  double duration = kInfinity;
  item.read("duration", &duration);
  wrench.end = wrench.start + duration;
  if (!(wrench.end > wrench.start))
    item.at("duration")
        .fail("must be > 0 and not lost beside the start, got " + shortest(duration));
  return wrench;
}

// ---- state that a saved scene continues from

/// Reads the number of a shape in its body, 0 without the key.
void read_part(const YamlElement& item, const char* key, const Body& body, int* part) {
  const auto value = item.find(key);
  if (!value) return;
  const std::uint64_t number = value->count();
  if (number >= part_count(body.shape))
    value->fail("is no shape of the body, got " + std::to_string(number));
  *part = static_cast<int>(number);
}

TouchingPair read_contact(const YamlElement& item, const World& world) {
  item.expect_keys({"body_a", "body_b", "part_a", "part_b", "normal", "points"});
  TouchingPair pair;
  pair.id_a = read_body_reference(item, "body_a", world);
  pair.id_b = read_body_reference(item, "body_b", world);
  if (!may_collide(world.body(pair.id_a), world.body(pair.id_b)))
    item.fail("body_a and body_b do not collide");
  read_part(item, "part_a", world.body(pair.id_a), &pair.part_a);
  read_part(item, "part_b", world.body(pair.id_b), &pair.part_b);
  item.read("normal", &pair.manifold.normal);
  item.attempt([&] {
    const Eigen::Vector3d& normal = pair.manifold.normal;
    if (!(std::abs(normal.norm() - 1.0) <= 0.01))
      refuse("normal", "must be a unit vector, got " + shown(normal));
  });
  const List<YamlElement> points = item.at("points").items();
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
      check_saved("position", point.position);
      check_saved("depth", point.depth);
      check_finite("impulse", pair.impulses[k]);
    });
  }
  return pair;
}

IslandMemory read_island(const YamlElement& item) {
  item.expect_keys({"first_body", "quiet_for", "is_stiff", "stiff_ticks", "stiff_until",
                    "refused_until", "contacts_refused_until", "left_for", "is_in_group",
                    "touched_until", "inconsistent_until", "gradient_iterations", "substep_cost"});
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
  read("contacts_refused_until", &memory.contacts_refused_until);
  std::uint64_t left_for = 0;
  read("left_for", &left_for);
  if (left_for > static_cast<std::uint64_t>(MethodReason::kOverlap))
    item.at("left_for").fail("there is no such reason");
  memory.left_for = static_cast<MethodReason>(left_for);
  item.read("is_in_group", &memory.is_in_group);
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

List<YamlElement> items_of(const YamlElement& scene, const std::string& key) {
  const auto list = scene.find(key);
  return list ? list->items() : List<YamlElement>{};
}

/// Returns whether a body was asleep when the scene was saved.
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
  auto& impl = ImplAccess::of(*world);
  continue_asleep(asleep, &impl);
  for (const YamlElement& item : items_of(scene, "contacts")) {
    const TouchingPair pair = read_contact(item, *world);
    item.attempt([&] { continue_contact(pair, &impl); });
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
  World world(options ? read_options(*options, defaults, {"clock"}) : defaults);

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
    auto& impl = ImplAccess::of(world);
    // Saved joints continue even where they contradict each other or their own functions fail.
    const JointId id =
        item.attempt([&] { return impl.add_joint(joint, broken, state.has_value()); });
    if (state) {
      continue_joint(impl.index(id), read_joint_state(*state, joint.kind), &impl);
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
    auto& impl = ImplAccess::of(world);
    const std::size_t i = impl.index(world.find_body(item.at("name").word()));
    const Twist value = correction->numbers(6);
    item.attempt([&] { continue_correction(i, value, &impl); });
  }
  return world;
}

}  // namespace constraint_sim::engine
