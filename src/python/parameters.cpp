#include "python/parameters.h"

#include <pybind11/stl.h>

#include <array>
#include <stdexcept>
#include <utility>
#include <variant>

#include "engine/model/fields.h"

namespace constraint_sim::python {
namespace {

// ---- parameters, one line each: `visit(key, field)` serves reading and writing

template <class Body, class Visit>
void visit_body(Body& body, Visit visit) {
  visit("name", body.name);
  visit("mass", body.mass);
  visit("inertia", body.inertia);
  engine::visit_fields(body.state, visit);
  visit("friction", body.friction);
  visit("restitution", body.restitution);
  visit("no_collision", body.no_collision);
  visit("collision_groups", body.collision_groups);
  visit("collision_mask", body.collision_mask);
  visit("gravity_compensation", body.gravity_compensation);
}

template <class Joint, class Visit>
void visit_joint(Joint& joint, Visit visit) {
  visit("name", joint.name);
  visit("anchor_a", joint.anchor_a);
  visit("anchor_b", joint.anchor_b);
  engine::visit_list(engine::kJointSettings, joint, visit);
}

template <class Value>
py::object to_python(const Value& value) {
  return py::cast(value);
}
template <>
py::object to_python(const Eigen::Vector3d& value) {
  return tuple_of(value);
}
template <>
py::object to_python(const engine::Method& value) {
  return py::cast(engine::name(value));
}
template <>
py::object to_python(const Eigen::Quaterniond& value) {
  return py::make_tuple(value.x(), value.y(), value.z(), value.w());
}

template <class Struct>
py::dict dict_of(const Struct& object);
template <>
py::object to_python(const std::optional<engine::Motor>& value) {
  return value ? py::object(dict_of(*value)) : py::none();
}
template <>
py::object to_python(const std::optional<engine::ShapePose>& value) {
  return value ? py::object(dict_of(*value)) : py::none();
}

auto writer(py::dict* dict) {
  return [dict](const char* key, const auto& field, auto...) { (*dict)[key] = to_python(field); };
}

template <class Struct>
py::dict dict_of(const Struct& object) {
  py::dict dict;
  engine::visit_fields(object, writer(&dict));
  return dict;
}

py::dict as_dict(const std::string& field, const py::object& value) {
  if (!py::isinstance<py::dict>(value))
    throw std::invalid_argument(field + ": must be a dict, got " +
                                std::string(py::str(py::repr(value))));
  return value.cast<py::dict>();
}

/// Returns the value named `text` in this list; throws std::invalid_argument naming `field`.
template <class Value, std::size_t count>
Value named(const std::string& field, const std::string& text,
            const std::array<std::pair<const char*, Value>, count>& list) {
  std::string existing;
  for (const auto& [name, value] : list) {
    if (text == name) return value;
    existing += (existing.empty() ? "" : ", ") + std::string(name);
  }
  throw std::invalid_argument(field + ": there is no '" + text + "'; there are " + existing);
}

auto method_names() {
  std::array<std::pair<const char*, engine::Method>, engine::kMethodCount> names;
  for (std::size_t i = 0; i < names.size(); ++i) {
    const auto method = static_cast<engine::Method>(i);
    names[i] = {engine::name(method), method};
  }
  return names;
}

constexpr std::array<std::pair<const char*, engine::BodyType>, 3> kBodyTypes{{
    {"dynamic", engine::BodyType::kDynamic},
    {"static", engine::BodyType::kStatic},
    {"kinematic", engine::BodyType::kKinematic},
}};

template <class Value>
void read(Keywords* keywords, const char* key, Value* value) {
  keywords->read(key, value);
}
void read(Keywords* keywords, const char* key, engine::Method* value) {
  std::string text = engine::name(*value);
  keywords->read(key, &text);
  *value = named(key, text, method_names());
}

/// Reads the motor of a coordinate; None keeps the motor.
void read(Keywords* keywords, const char* key, std::optional<engine::Motor>* value) {
  const py::object motor = keywords->find(key);
  if (motor && !motor.is_none()) motor_from(as_dict(key, motor), &value->emplace());
}

auto reader(Keywords* keywords) {
  return [keywords](const char* key, auto& field, auto...) { read(keywords, key, &field); };
}

engine::BodyId body_named(const engine::World& world, const std::string& name) {
  return name == "world" ? engine::kWorldBody : world.find_body(name);
}

}  // namespace

py::tuple tuple_of(const Eigen::Vector3d& vector) {
  return py::make_tuple(vector.x(), vector.y(), vector.z());
}

// ---- options

void options_from(const py::dict& keywords, engine::WorldOptions* target) {
  Keywords reading("options", keywords);
  engine::WorldOptions options = *target;
  engine::visit_options(options, [&](const engine::OptionInfo& info, auto& value, auto) {
    read(&reading, info.name, &value);
  });
  reading.expect_no_more();
  engine::validate(options);
  *target = options;
}

py::dict options_dict(const engine::WorldOptions& options) {
  py::dict dict;
  engine::visit_options(options, [&](const engine::OptionInfo& info, const auto& value, auto) {
    dict[info.name] = to_python(value);
  });
  return dict;
}

// ---- bodies

engine::Shape shape_from(const py::object& value) {
  try {
    return value.cast<engine::Shape>();
  } catch (const py::cast_error&) {
    throw std::invalid_argument(
        "shape: must be a Point, Sphere, Box, Plane, Cylinder, Hull, Capsule or Compound, got " +
        std::string(py::str(py::repr(value))));
  }
}

std::optional<engine::ShapePose> shape_pose_from(const py::object& value) {
  if (value.is_none()) return std::nullopt;
  if (!py::isinstance<py::dict>(value))
    throw std::invalid_argument("shape_pose: must be a dict of position and orientation, got " +
                                std::string(py::str(py::repr(value))));
  Keywords reading("shape_pose", value.cast<py::dict>());
  engine::ShapePose pose;
  engine::visit_fields(pose, reader(&reading));
  reading.expect_no_more();
  return pose;
}

py::dict shape_pose_dict(const engine::ShapePose& pose) { return dict_of(pose); }

void body_from(const py::dict& keywords, engine::Body* target) {
  Keywords reading("add_body", keywords);
  visit_body(*target, reader(&reading));
  std::string type = "dynamic";
  reading.read("type", &type);
  target->type = named("type", type, kBodyTypes);
  if (const py::object shape = reading.find("shape")) target->shape = shape_from(shape);
  if (const py::object pose = reading.find("shape_pose"))
    target->shape_pose = shape_pose_from(pose);
  reading.expect_no_more();
}

py::dict body_dict(const engine::Body& body) {
  py::dict dict;
  visit_body(body, writer(&dict));
  for (const auto& [name, type] : kBodyTypes)
    if (type == body.type) dict["type"] = name;
  dict["shape"] = body.shape;
  dict["shape_pose"] = to_python(body.shape_pose);
  return dict;
}

void state_from(const py::dict& keywords, engine::BodyState* target) {
  Keywords reading("set_state", keywords);
  engine::visit_fields(*target, reader(&reading));
  reading.expect_no_more();
}

py::dict state_dict(const engine::BodyState& state) { return dict_of(state); }

std::string body_name(const engine::World& world, engine::BodyId id) {
  return id == engine::kWorldBody ? "world" : world.body(id).name;
}

// ---- joints

void motor_from(const py::dict& keywords, engine::Motor* target) {
  Keywords reading("motor", keywords);
  engine::visit_fields(*target, reader(&reading));
  reading.expect_no_more();
}

void velocity_motor_from(const py::dict& keywords, engine::Motor* target) {
  Keywords reading("motor", keywords);
  engine::visit_list(engine::kVelocityMotor, *target, reader(&reading));
  reading.expect_no_more();
}

namespace {

/// Reads a law; returns whether any keyword was given.
bool read_law(Keywords* reading, engine::CoordinateLaw* law) {
  bool is_given = false;
  engine::visit_fields(*law, [&](const char* key, auto& field, auto) {
    is_given |= static_cast<bool>(reading->find(key));
    read(reading, key, &field);
  });
  return is_given;
}

/// Reads the laws of the first coordinate, or of all in a list.
void read_laws(Keywords* reading, engine::Joint* joint) {
  const bool is_flat = read_law(reading, joint->coordinates.data());
  const py::object list = reading->find("coordinates");
  if (!list) return;
  if (is_flat) throw std::invalid_argument("coordinates: give these or the first one's keywords");
  if (!py::isinstance<py::sequence>(list) || py::isinstance<py::str>(list))
    throw std::invalid_argument("coordinates: must be a list of dicts, got " +
                                std::string(py::str(py::repr(list))));
  const auto count = static_cast<std::size_t>(engine::info(joint->kind).coordinates);
  const auto laws = list.cast<py::sequence>();
  if (laws.size() > count)
    throw std::invalid_argument("coordinates: a " + std::string(engine::name(joint->kind)) +
                                " joint has " + std::to_string(count) + ", got " +
                                std::to_string(laws.size()));
  for (std::size_t i = 0; i < laws.size(); ++i) {
    Keywords law("coordinates", as_dict("coordinates", laws[i]));
    read_law(&law, &joint->coordinates[i]);
    law.expect_no_more();
  }
}

}  // namespace

namespace {

/// Reads the further keywords of gears, pulleys and screws.
void read_coupling(Keywords* reading, const engine::World& world, engine::Joint* joint) {
  reading->read("value", &joint->coupling.value);
  if (engine::info(joint->kind).has_pitch) reading->read("pitch", &joint->pitch);
  if (!engine::info(joint->kind).couples_joints) return;
  reading->read("ratio", &joint->coupling.ratio);
  if (engine::info(joint->kind).couples_lengths)
    reading->read("one_sided", &joint->coupling.one_sided);
  const py::object names = reading->find("joints");
  if (!names || !py::isinstance<py::sequence>(names) || py::isinstance<py::str>(names) ||
      py::len(names) != 2 || !py::isinstance<py::str>(names.cast<py::sequence>()[0]) ||
      !py::isinstance<py::str>(names.cast<py::sequence>()[1]))
    throw std::invalid_argument("joints: must be the names of two constraints");
  const auto list = names.cast<py::sequence>();
  joint->coupling.first = world.find_joint(list[0].cast<std::string>());
  joint->coupling.second = world.find_joint(list[1].cast<std::string>());
}

}  // namespace

engine::Joint joint_from(const py::dict& keywords, const engine::World& world, bool* broken) {
  Keywords reading("add_joint", keywords);
  engine::Joint joint;
  visit_joint(joint, reader(&reading));
  std::string type = "distance", body_a = "world", body_b = "world";
  reading.read("type", &type);
  reading.read("body_a", &body_a);
  reading.read("body_b", &body_b);
  reading.read("broken", broken);
  joint.body_a = body_named(world, body_a);
  joint.body_b = body_named(world, body_b);
  bool is_free = false;
  reading.read("free", &is_free);
  if (is_free && type == "distance") type = engine::name(engine::JointKind::kFreeDistance);
  const std::optional<engine::JointKind> kind = engine::joint_kind_named(type);
  if (!kind)
    throw std::invalid_argument("type: there is no '" + type + "'; there are distance" +
                                engine::names_of_further_kinds());
  joint.kind = *kind;
  if (engine::info(joint.kind).couples) read_coupling(&reading, world, &joint);
  if (engine::if_distance(joint) != nullptr) engine::visit_fields(joint.distance, reader(&reading));
  if (engine::info(joint.kind).has_frames) {
    const auto is_given = [&](const char* key) { return static_cast<bool>(reading.find(key)); };
    if (is_given("axis_a")) {
      if (is_given("frame_a"))
        throw std::invalid_argument("axis_a: give this or frame_a, not both");
      Eigen::Vector3d axis = Eigen::Vector3d::Zero();
      reading.read("axis_a", &axis);
      joint.frame_a = engine::frame_along(axis);
    }
    reading.read("frame_a", &joint.frame_a);
    if (is_given("axis_b")) reading.read("axis_b", &joint.axis_b.emplace(Eigen::Vector3d::Zero()));
    if (is_given("frame_b"))
      reading.read("frame_b", &joint.frame_b.emplace(Eigen::Quaterniond::Identity()));
  }
  if (engine::info(joint.kind).coordinates > 0)
    read_laws(&reading, &joint);
  else if (const py::object motor = reading.find("motor"))
    velocity_motor_from(as_dict("motor", motor), &joint.motor);
  reading.expect_no_more();
  return joint;
}

void change_joint(const py::dict& keywords, engine::Joint* joint) {
  Keywords reading("set_joint", keywords);
  engine::visit_list(engine::kJointSettings, *joint, reader(&reading));
  if (auto* distance = engine::if_distance(*joint)) {
    engine::visit_fields(*distance, reader(&reading));
    if (const py::object motor = reading.find("motor")) {
      joint->motor = engine::Motor{};
      if (!motor.is_none()) velocity_motor_from(as_dict("motor", motor), &joint->motor);
    }
  }
  if (const int count = engine::info(joint->kind).coordinates) {
    int coordinate = 0;
    reading.read("coordinate", &coordinate);
    if (coordinate < 0 || coordinate >= count)
      throw std::invalid_argument("coordinate: a " + std::string(engine::name(joint->kind)) +
                                  " joint has " + std::to_string(count) + ", got number " +
                                  std::to_string(coordinate));
    engine::CoordinateLaw& law = joint->coordinates[static_cast<std::size_t>(coordinate)];
    const py::object motor = reading.find("motor");
    if (motor) law.motor.reset();
    read_law(&reading, &law);
  }
  reading.expect_no_more();
}

py::dict joint_dict(const engine::Joint& joint, const engine::World& world, bool broken) {
  py::dict dict;
  visit_joint(joint, writer(&dict));
  dict["type"] = engine::name(joint.kind);
  if (engine::info(joint.kind).has_frames) {
    dict["frame_a"] = to_python(joint.frame_a);
    dict["frame_b"] = to_python(*joint.frame_b);
  }
  dict["body_a"] = body_name(world, joint.body_a);
  dict["body_b"] = body_name(world, joint.body_b);
  if (engine::info(joint.kind).couples_joints) {
    for (const char* key : {"body_a", "body_b", "anchor_a", "anchor_b"}) dict.attr("pop")(key);
    dict["joints"] = py::make_tuple(world.joint(joint.coupling.first).name,
                                    world.joint(joint.coupling.second).name);
    dict["ratio"] = joint.coupling.ratio;
    if (engine::info(joint.kind).couples_lengths) dict["one_sided"] = joint.coupling.one_sided;
  }
  if (engine::info(joint.kind).has_pitch) dict["pitch"] = joint.pitch;
  if (engine::info(joint.kind).couples)
    dict["value"] = world.joint_state(world.find_joint(joint.name)).coupling.constant;
  if (const auto* distance = engine::if_distance(joint)) {
    engine::visit_fields(*distance, writer(&dict));
    py::dict motor;
    engine::visit_list(engine::kVelocityMotor, joint.motor, writer(&motor));
    dict["motor"] = motor;
  }
  if (const int count = engine::info(joint.kind).coordinates) {
    py::list laws;
    for (int i = 0; i < count; ++i)
      laws.append(dict_of(joint.coordinates[static_cast<std::size_t>(i)]));
    dict["coordinates"] = laws;
  }
  dict["broken"] = broken;
  return dict;
}

}  // namespace constraint_sim::python
