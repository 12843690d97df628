#include <yaml-cpp/yaml.h>

#include <algorithm>
#include <cmath>
#include <memory>
#include <type_traits>

#include "constraint_sim/engine/scene.h"
#include "engine/constraints/joint_kinds.h"
#include "engine/constraints/law.h"
#include "engine/edits/saved_state.h"
#include "engine/math/list.h"
#include "engine/model/fields.h"
#include "engine/model/shape_names.h"
#include "engine/model/validate.h"
#include "engine/world/next_islands.h"
#include "engine/world/world_impl.h"

namespace constraint_sim::engine {
namespace {

void write(YAML::Emitter* out, const char* key, const std::string& value) {
  *out << YAML::Key << key << YAML::Value << value;
}

void write(YAML::Emitter* out, const char* key, const char* value) {
  write(out, key, std::string(value));
}

void write(YAML::Emitter* out, const char* key, Method value) { write(out, key, name(value)); }

std::string number(double value) { return std::isinf(value) ? ".inf" : shortest(value); }

void write(YAML::Emitter* out, const char* key, double value) { write(out, key, number(value)); }

void write(YAML::Emitter* out, const char* key, const std::optional<double>& value) {
  if (value) write(out, key, *value);
}

template <class Whole, class = std::enable_if_t<std::is_integral_v<Whole>>>
void write(YAML::Emitter* out, const char* key, Whole value) {
  *out << YAML::Key << key << YAML::Value << value;
}

void write(YAML::Emitter* out, const char* key, const Eigen::Ref<const Eigen::VectorXd>& values) {
  *out << YAML::Key << key << YAML::Value << YAML::Flow << YAML::BeginSeq;
  for (Eigen::Index i = 0; i < values.size(); ++i) *out << shortest(values[i]);
  *out << YAML::EndSeq;
}

void write(YAML::Emitter* out, const char* key, const std::shared_ptr<const ConvexHull>& surface) {
  *out << YAML::Key << key << YAML::Value << YAML::Flow << YAML::BeginSeq;
  for (const Eigen::Vector3d& vertex : surface->vertices()) {
    *out << YAML::Flow << YAML::BeginSeq;
    for (const double x : vertex) *out << shortest(x);
    *out << YAML::EndSeq;
  }
  *out << YAML::EndSeq;
}

/// Writes time and step, unless the world is at its start.
void write_clock(YAML::Emitter* out, const World& world) {
  const auto& impl = ImplAccess::of(world);
  if (impl.step_count == 0 && impl.base_time == 0.0) return;
  *out << YAML::Key << "clock" << YAML::Value << YAML::Flow << YAML::BeginMap;
  write(out, "time", impl.base_time);
  write(out, "since", impl.base_step);
  write(out, "step", impl.step_count);
  *out << YAML::EndMap;
}

void write_options(YAML::Emitter* out, const World& world) {
  const WorldOptions& options = world.options();
  *out << YAML::Key << "world" << YAML::Value << YAML::BeginMap;
  visit_options(options, [out](const OptionInfo& info, const auto& value, auto) {
    write(out, info.name, value);
  });
  write_clock(out, world);
  *out << YAML::EndMap;
}

// ---- bodies

template <class Struct>
void write_fields(YAML::Emitter* out, const Struct& object);

void write(YAML::Emitter* out, const char* key, BodyType type) {
  write(out, key, kBodyTypeNames[static_cast<std::size_t>(type)]);
}

void write(YAML::Emitter* out, const char* key, const Eigen::Quaterniond& q) {
  write(out, key, q.coeffs());
}

void write(YAML::Emitter* out, const char* key,
           const std::shared_ptr<const Compound::Parts>& parts);

void write(YAML::Emitter* out, const char* key, const Shape& shape) {
  if (const auto* compound = std::get_if<Compound>(&shape))
    return write(out, "shapes", compound->parts);
  *out << YAML::Key << key << YAML::Value << YAML::Flow << YAML::BeginMap;
  *out << YAML::Key << kShapeNames[shape.index()] << YAML::Value << YAML::Flow << YAML::BeginMap;
  std::visit([out](const auto& of_kind) { write_fields(out, of_kind); }, shape);
  *out << YAML::EndMap << YAML::EndMap;
}

void write(YAML::Emitter* out, const char* key, const ShapePose& pose) {
  *out << YAML::Key << key << YAML::Value << YAML::Flow << YAML::BeginMap;
  write_fields(out, pose);
  *out << YAML::EndMap;
}

void write(YAML::Emitter* out, const char* key, const std::optional<ShapePose>& pose) {
  if (pose) write(out, key, *pose);
}

void write(YAML::Emitter* out, const char* key, const std::optional<std::array<double, 4>>& color) {
  if (color) write(out, key, Eigen::Map<const Eigen::VectorXd>(color->data(), 4));
}

void write(YAML::Emitter* out, const char* key,
           const std::shared_ptr<const Compound::Parts>& parts) {
  *out << YAML::Key << key << YAML::Value << YAML::BeginSeq;
  for (const ShapePart& part : *parts) {
    *out << YAML::Flow << YAML::BeginMap;
    write_fields(out, part);
    *out << YAML::EndMap;
  }
  *out << YAML::EndSeq;
}

template <class Struct>
void write_fields(YAML::Emitter* out, const Struct& object) {
  visit_fields(object, [out](const char* key, const auto& value, auto) { write(out, key, value); });
}

void write_body(YAML::Emitter* out, const World& world, BodyId id) {
  Body body = world.body(id);
  body.state = world.state(id);
  const auto& impl = ImplAccess::of(world);
  *out << YAML::BeginMap;
  write_fields(out, body);
  const std::size_t i = impl.index(id);
  if (impl.asleep[i]) write(out, "asleep", true);
  if (impl.any_corrections && !impl.corrections[i].isZero(0.0))
    write(out, "correction", impl.corrections[i]);
  *out << YAML::EndMap;
}

// ---- constraints

void write_distance(YAML::Emitter* out, const DistanceJoint& distance) {
  const bool has_length = !distance.is_limited() || distance.is_soft();
  if (has_length) write(out, "length", distance.length);
  if (distance.min_length > 0.0) write(out, "min_length", distance.min_length);
  if (std::isfinite(distance.max_length)) write(out, "max_length", distance.max_length);
  if (!distance.is_soft()) return;
  write(out, "stiffness", distance.stiffness);
  write(out, "damping", distance.damping);
  if (distance.one_sided) write(out, "one_sided", true);
}

/// Writes the velocity motor of a length.
void write_motor(YAML::Emitter* out, const Motor& motor) {
  if (are_same(motor, Motor{})) return;
  *out << YAML::Key << "motor" << YAML::Value << YAML::Flow << YAML::BeginMap;
  visit_list(kVelocityMotor, motor,
             [out](const char* key, double value, auto) { write(out, key, value); });
  *out << YAML::EndMap;
}

/// Writes the motor of a coordinate: by velocity, to a position or with a force.
void write(YAML::Emitter* out, const char* key, const std::optional<Motor>& motor) {
  *out << YAML::Key << key << YAML::Value << YAML::Flow << YAML::BeginMap;
  if (motor->position) {
    write(out, "position", *motor->position);
    if (motor->is_servo()) {
      write(out, "servo_stiffness", motor->servo_stiffness);
      write(out, "servo_damping", motor->servo_damping);
    }
  } else if (motor->force) {
    write(out, "force", *motor->force);
  } else {
    write(out, "bias", motor->bias);
    write(out, "amplitude", motor->amplitude);
    write(out, "frequency", motor->frequency);
    write(out, "phase", motor->phase);
  }
  write(out, "max_force", motor->max_force);
  write(out, "timeout", motor->timeout);
  *out << YAML::EndMap;
}

/// Writes the settings of a law that differ from their defaults.
void write_law(YAML::Emitter* out, const CoordinateLaw& law) {
  const CoordinateLaw none;
  const auto write_changed = [&](const auto& field) {
    if (!are_same(law.*field.member, none.*field.member)) write(out, field.key, law.*field.member);
  };
  std::apply([&](const auto&... field) { (write_changed(field), ...); }, kFields<CoordinateLaw>);
}

void write_laws(YAML::Emitter* out, const Joint& joint) {
  const auto count = static_cast<std::size_t>(info(joint.kind).coordinates);
  const auto is_none = [](const CoordinateLaw& law) { return law.is_none() && law.rest == 0.0; };
  if (std::all_of(joint.coordinates.begin() + 1, joint.coordinates.end(), is_none)) {
    if (count > 0) write_law(out, joint.coordinates[0]);
    return;
  }
  *out << YAML::Key << "coordinates" << YAML::Value << YAML::BeginSeq;
  for (std::size_t i = 0; i < count; ++i) {
    *out << YAML::Flow << YAML::BeginMap;
    write_law(out, joint.coordinates[i]);
    *out << YAML::EndMap;
  }
  *out << YAML::EndSeq;
}

/// Writes a number per row and coordinate of a joint, at least three.
void write_rows(YAML::Emitter* out, const char* key, const Joint& joint, const RowVector& rows) {
  write(out, key,
        Eigen::VectorXd(
            rows.head(std::max(forms(joint.kind).rows + forms(joint.kind).coordinates, 3))));
}

/// Writes ends of biases: one time for a length, or for a single timeout on the first coordinate;
/// else a list.
void write_expiry(YAML::Emitter* out, const Joint& joint, const JointState& state) {
  List<double> ends;
  visit_motors(joint, state, [&](const Motor& motor, double end) {
    if (motor.timeout > 0.0) ends.push_back(end);
  });
  if (ends.empty()) return;
  const int count = info(joint.kind).coordinates;
  const auto& first = joint.coordinates[0].motor;
  if (count == 0 || (ends.size() == 1 && first && first->timeout > 0.0))
    return write(out, "expires_at", ends.front());
  *out << YAML::Key << "expires_at" << YAML::Value << YAML::Flow << YAML::BeginSeq;
  for (int i = 0; i < count; ++i)
    *out << number(state.coordinates[static_cast<std::size_t>(i)].expires_at);
  *out << YAML::EndSeq;
}

/// Writes the motions of coordinates to new positions, one for each coordinate.
void write_moving(YAML::Emitter* out, int count,
                  const std::array<MovingStart, kMaxCoordinates>& moving) {
  const auto moves = [](const MovingStart& start) { return start.duration > 0.0; };
  if (std::none_of(moving.begin(), moving.end(), moves)) return;
  *out << YAML::Key << "moving" << YAML::Value << YAML::Flow << YAML::BeginSeq;
  for (std::size_t i = 0; i < to_index(count); ++i) {
    *out << YAML::Flow << YAML::BeginSeq;
    for (const double number : {moving[i].since, moving[i].duration, moving[i].offset,
                                moving[i].rate, moving[i].acceleration})
      *out << shortest(number);
    *out << YAML::EndSeq;
  }
  *out << YAML::EndSeq;
}

/// Writes the state that a joint continues from, unless adding the joint gives the same state.
void write_state(YAML::Emitter* out, const World& world, const Joint& joint,
                 const JointData& state) {
  const auto& impl = ImplAccess::of(world);
  const JointId id = world.find_joint(joint.name);
  if (is_as_added(impl, id)) return;
  *out << YAML::Key << "state" << YAML::Value << YAML::Flow << YAML::BeginMap;
  write(out, "travel", state.travel);
  if (state.saturated) write(out, "saturated", true);
  write_expiry(out, joint, state);
  if (const int count = info(joint.kind).coordinates) {
    Eigen::VectorXd positions(count), held(count), braking(count);
    for (int i = 0; i < count; ++i) {
      positions[i] = state.coordinates[static_cast<std::size_t>(i)].position;
      held[i] = state.coordinates[static_cast<std::size_t>(i)].held;
      braking[i] = state.coordinates[static_cast<std::size_t>(i)].braking;
    }
    write(out, "positions", positions);
    write(out, "held", held);
    if (!braking.isZero(0.0)) write(out, "braking", braking);
  }
  write_rows(out, "impulse", joint, state.impulse);
  if (info(joint.kind).couples) {
    write(out, "coupling_constant", state.coupling.constant);
    write(out, "coupling_impulse", state.coupling_impulse);
  }
  const SelfStress& self_stress = impl.self_stress[impl.index(id)];
  if (!self_stress.is_none()) {
    write_rows(out, "self_stress", joint, self_stress.share);
    write_rows(out, "self_stress_of", joint, self_stress.impulse);
  }
  if (state.closing) {
    write(out, "closing_since", state.to_close.since);
    write_rows(out, "closing_offset", joint, state.to_close.offset);
    if (closes_by_frame(forms(joint.kind))) {
      write(out, "closing_shift", state.to_close.shift);
      write(out, "closing_turn", state.to_close.turn);
      write(out, "closing_share", state.closing_share);
    }
    if (info(joint.kind).couples) write(out, "closing_coupling", state.to_close.coupling);
    write_moving(out, info(joint.kind).coordinates, state.to_close.moving);
    write(out, "initial_error", state.initial_error);
  }
  *out << YAML::EndMap;
}

void write_joint(YAML::Emitter* out, const World& world, const Joint& joint,
                 const JointData& state) {
  const auto body_name = [&](BodyId id) {
    return id == kWorldBody ? std::string("world") : world.body(id).name;
  };
  *out << YAML::BeginMap;
  write(out, "name", joint.name);
  const bool is_free = info(joint.kind).is_free_length;
  write(out, "type", name(is_free ? Joint{}.kind : joint.kind));
  if (is_free) write(out, "free", true);
  if (info(joint.kind).couples_joints) {
    *out << YAML::Key << "joints" << YAML::Value << YAML::Flow << YAML::BeginSeq;
    for (const JointId id : {joint.coupling.first, joint.coupling.second})
      *out << world.joint(id).name;
    *out << YAML::EndSeq;
    write(out, "ratio", joint.coupling.ratio);
    if (joint.coupling.one_sided) write(out, "one_sided", true);
  } else {
    write(out, "body_a", body_name(joint.body_a));
    write(out, "anchor_a", joint.anchor_a);
    write(out, "body_b", body_name(joint.body_b));
    write(out, "anchor_b", joint.anchor_b);
  }
  if (info(joint.kind).is_custom) {
    write(out, "custom", joint.custom.type);
    *out << YAML::Key << "parameters" << YAML::Value << YAML::Flow << YAML::BeginMap;
    for (const CustomParameter& parameter : joint.custom.parameters)
      write(out, parameter.name.c_str(), parameter.value);
    *out << YAML::EndMap;
  }
  if (info(joint.kind).has_pitch) write(out, "pitch", joint.pitch);
  // A constant beyond the bound of settings is saved by the state alone.
  if (info(joint.kind).couples && std::abs(state.coupling.constant) <= kMostMagnitude)
    write(out, "value", state.coupling.constant);
  if (info(joint.kind).has_frames) {
    write(out, "frame_a", joint.frame_a);
    write(out, "frame_b", *joint.frame_b);
  }
  if (const auto* distance = if_distance(joint)) write_distance(out, *distance);
  if (!info(joint.kind).couples_joints) write_motor(out, joint.motor);
  write_laws(out, joint);
  write(out, "baumgarte", joint.baumgarte);
  write(out, "break_force", joint.break_force);
  if (joint.break_torque > 0.0) write(out, "break_torque", joint.break_torque);
  write(out, "collide_connected", joint.collide_connected);
  if (!joint.enabled) write(out, "enabled", false);
  if (state.broken) write(out, "broken", true);
  write_state(out, world, joint, state);
  *out << YAML::EndMap;
}

void write_wrench(YAML::Emitter* out, const World& world, const Wrench& wrench) {
  *out << YAML::BeginMap;
  write(out, "body", world.body(wrench.body).name);
  write(out, "force", wrench.force);
  write(out, "torque", wrench.torque);
  // A start in the past has no effect.
  write(out, "start", std::max(wrench.start, world.time()));
  if (std::isfinite(wrench.end)) write(out, "end", wrench.end);
  *out << YAML::EndMap;
}

// ---- memory from step to step

void write_contact(YAML::Emitter* out, const World& world, const TouchingPair& pair) {
  *out << YAML::BeginMap;
  write(out, "body_a", world.body(pair.id_a).name);
  write(out, "body_b", world.body(pair.id_b).name);
  if (pair.part_a != 0) write(out, "part_a", pair.part_a);
  if (pair.part_b != 0) write(out, "part_b", pair.part_b);
  write(out, "normal", pair.manifold.normal);
  *out << YAML::Key << "points" << YAML::Value << YAML::BeginSeq;
  for (std::size_t k = 0; k < static_cast<std::size_t>(pair.manifold.count); ++k) {
    const Manifold::Point& point = pair.manifold.points[k];
    *out << YAML::Flow << YAML::BeginMap;
    write(out, "feature", std::uint64_t{point.feature});
    write(out, "position", point.position);
    write(out, "depth", point.depth);
    write(out, "impulse", pair.impulses[k]);
    *out << YAML::EndMap;
  }
  *out << YAML::EndSeq << YAML::EndMap;
}

void write_contacts(YAML::Emitter* out, const World& world) {
  const auto& impl = ImplAccess::of(world);
  const auto is_gone = [&](const TouchingPair& pair) { return !impl.is_known(pair); };
  List<TouchingPair> pairs = impl.touching;
  pairs.insert(pairs.end(), impl.resting.begin(), impl.resting.end());
  pairs.erase(std::remove_if(pairs.begin(), pairs.end(), is_gone), pairs.end());
  if (pairs.empty()) return;
  const auto in_order = [&](const TouchingPair& l, const TouchingPair& r) {
    return std::tuple(impl.index(l.id_a), impl.index(l.id_b), l.part_a, l.part_b) <
           std::tuple(impl.index(r.id_a), impl.index(r.id_b), r.part_a, r.part_b);
  };
  std::sort(pairs.begin(), pairs.end(), in_order);
  *out << YAML::Key << "contacts" << YAML::Value << YAML::BeginSeq;
  for (const TouchingPair& pair : pairs) write_contact(out, world, pair);
  *out << YAML::EndSeq;
}

void write_islands(YAML::Emitter* out, const World& world) {
  const auto memories = next_memories(ImplAccess::of(world));
  if (memories.empty()) return;
  *out << YAML::Key << "islands" << YAML::Value << YAML::BeginSeq;
  for (const auto& [first_body, memory] : memories) {
    *out << YAML::Flow << YAML::BeginMap;
    write(out, "first_body", world.body(first_body).name);
    write(out, "quiet_for", memory.quiet_for);
    write(out, "is_stiff", memory.is_stiff);
    write(out, "stiff_ticks", static_cast<std::uint64_t>(memory.stiff_ticks));
    write(out, "stiff_until", memory.stiff_until);
    write(out, "refused_until", memory.refused_until);
    if (memory.contacts_refused_until > 0)
      write(out, "contacts_refused_until", memory.contacts_refused_until);
    if (memory.left_for != MethodReason::kSmooth)
      write(out, "left_for", static_cast<std::uint64_t>(memory.left_for));
    if (memory.is_in_group) write(out, "is_in_group", true);
    write(out, "touched_until", memory.touched_until);
    write(out, "inconsistent_until", memory.inconsistent_until);
    write(out, "gradient_iterations", std::uint64_t{memory.gradient_iterations});
    write(out, "substep_cost", memory.substep_cost);
    *out << YAML::EndMap;
  }
  *out << YAML::EndSeq;
}

}  // namespace

std::string save_scene(const World& world) {
  YAML::Emitter out;
  out << YAML::BeginMap;
  write_options(&out, world);
  out << YAML::Key << "bodies" << YAML::Value << YAML::BeginSeq;
  for (const BodyId id : world.body_ids()) write_body(&out, world, id);
  out << YAML::EndSeq;
  out << YAML::Key << "constraints" << YAML::Value << YAML::BeginSeq;
  for (const JointId id : world.joint_ids())
    write_joint(&out, world, world.joint(id), joint_data(world, id));
  out << YAML::EndSeq;
  if (!world.wrenches().empty()) {
    out << YAML::Key << "wrenches" << YAML::Value << YAML::BeginSeq;
    for (const Wrench& wrench : world.wrenches()) write_wrench(&out, world, wrench);
    out << YAML::EndSeq;
  }
  write_contacts(&out, world);
  write_islands(&out, world);
  out << YAML::EndMap;
  return std::string(out.c_str()) + "\n";
}

}  // namespace constraint_sim::engine
