#include <algorithm>
#include <cstring>
#include <memory>
#include <type_traits>

#include "engine/constraints/joint_kinds.h"
#include "engine/math/fnv1a.h"
#include "engine/math/list.h"
#include "engine/model/fields.h"
#include "engine/world/next_islands.h"
#include "engine/world/world_impl.h"

namespace constraint_sim::engine {
namespace {

/// Hash over the bytes of all added values.
class Fnv1a {
 public:
  void add(const void* data, std::size_t size) { hash_ = fnv1a(data, size, hash_); }
  void add(double value) { add(&value, sizeof value); }
  void add(std::uint64_t value) { add(&value, sizeof value); }
  void add(int value) { add(static_cast<std::uint64_t>(value)); }
  void add(bool value) { add(std::uint64_t{value}); }
  void add(Method value) { add(std::string(name(value))); }
  void add(const std::string& text) {
    add(std::uint64_t{text.size()});
    add(text.data(), text.size());
  }
  void add(const Eigen::Vector3d& v) { add(v.data(), 3 * sizeof(double)); }
  void add(const std::shared_ptr<const ConvexHull>& surface) {
    add(std::uint64_t{surface->vertices().size()});
    for (const Eigen::Vector3d& vertex : surface->vertices()) add(vertex);
  }
  void add(const std::shared_ptr<const Compound::Parts>& parts) {
    add(std::uint64_t{parts->size()});
    const auto add_field = [this](const char*, const auto& value, auto) { add(value); };
    for (const ShapePart& part : *parts) visit_fields(part, add_field);
  }
  void add(const Shape& shape) {
    add(std::uint64_t{shape.index()});
    const auto add_field = [this](const char*, const auto& value, auto) { add(value); };
    std::visit([&](const auto& of_kind) { visit_fields(of_kind, add_field); }, shape);
  }
  void add(const ShapePose& pose) {
    visit_fields(pose, [this](const char*, const auto& value, auto) { add(value); });
  }
  void add(const std::optional<double>& value) {
    add(value.has_value());
    if (value) add(*value);
  }
  void add(const Eigen::Quaterniond& q) { add(q.coeffs().data(), 4 * sizeof(double)); }

  std::uint64_t value() const { return hash_; }

 private:
  std::uint64_t hash_ = kEmptyFnv1a;
};

/// Visitor that adds the memory of methods to a hash (engine/support/memory.h).
class MemoryHash {
 public:
  static constexpr bool kReads = false;

  explicit MemoryHash(Fnv1a* hash) : hash_(hash) {}

  template <class Value>
  void beside(const Value&) const {}

  void operator()(double value) const { hash_->add(value); }
  void operator()(bool value) const { hash_->add(std::uint64_t{value}); }
  void operator()(char value) const { hash_->add(static_cast<std::uint64_t>(value)); }
  void operator()(signed char value) const { (*this)(int{value}); }
  void operator()(int value) const { hash_->add(static_cast<std::uint64_t>(value)); }
  template <class Enum, class = std::enable_if_t<std::is_enum_v<Enum>>>
  void operator()(Enum value) const {
    (*this)(static_cast<int>(value));
  }
  void operator()(const Eigen::Vector3d& v) const { hash_->add(v); }
  void operator()(const Eigen::Vector4d& v) const { hash_->add(v.data(), 4 * sizeof(double)); }
  template <class Element>
  void operator()(const List<Element>& list) const {
    hash_->add(std::uint64_t{list.size()});
    for (std::size_t i = 0; i < list.size(); ++i) (*this)(static_cast<const Element&>(list[i]));
  }

 private:
  Fnv1a* hash_;
};

// Returns the indices of a list from `first` on, in the alphabetical order of its names.
template <class Container>
List<std::size_t> by_name(const Container& list, std::size_t first) {
  List<std::size_t> order;
  for (std::size_t i = first; i < list.size(); ++i) order.push_back(i);
  std::sort(order.begin(), order.end(),
            [&](std::size_t l, std::size_t r) { return list[l].name < list[r].name; });
  return order;
}

void add(Fnv1a& hash, const WorldOptions& options) {
  WorldOptions deciding = options;
  deciding.threads = 1;  // the number of threads changes no result
  visit_options(deciding, [&](const OptionInfo&, const auto& value, auto) { hash.add(value); });
}

void add(Fnv1a& hash, const Body& body, const MassProperties& mass, const BodyState& state) {
  hash.add(body.name);
  hash.add(static_cast<std::uint64_t>(body.type));
  hash.add(body.shape);
  const auto add_field = [&](const char*, const auto& value, auto) { hash.add(value); };
  if (body.shape_pose) visit_fields(*body.shape_pose, add_field);
  hash.add(body.mass);
  hash.add(mass.inertia);
  hash.add(body.friction);
  hash.add(body.restitution);
  hash.add(std::uint64_t{body.no_collision});
  if (body.gravity_compensation != 0.0) hash.add(body.gravity_compensation);
  if (body.collision_groups != 1 || body.collision_mask != kAllGroups)
    hash.add(std::uint64_t{body.collision_groups} << 32 | body.collision_mask);
  visit_fields(state, add_field);
}

// Adds rows 1 to 3, and rows 4 to 6 where one of them is not zero: a ball joint has three rows.
void add(Fnv1a& hash, const RowVector& rows) {
  hash.add(Eigen::Vector3d(rows.head<3>()));
  if (!rows.tail<3>().isZero(0.0)) hash.add(Eigen::Vector3d(rows.tail<3>()));
}

void add_settings(Fnv1a& hash, const Joint& joint) {
  if (const DistanceJoint* distance = if_distance(joint)) {
    hash.add(distance->length.value_or(-1.0));
    for (const double number :
         {distance->min_length, distance->max_length, distance->stiffness, distance->damping})
      hash.add(number);
    if (distance->one_sided) hash.add(std::string("one-sided"));
  }
  if (joint.coupling.one_sided) hash.add(std::string("one-sided"));
  if (info(joint.kind).is_custom) {
    hash.add(joint.custom.type);
    for (const CustomParameter& parameter : joint.custom.parameters) {
      hash.add(parameter.name);
      hash.add(parameter.value);
    }
  }
  if (!info(joint.kind).has_frames) return;
  hash.add(joint.frame_a);
  hash.add(*joint.frame_b);
}

// Angles within it are in their first turn, which the poses of the bodies tell: just beyond π, for
// rounding [rad]. Translations follow from the poses anyhow.
constexpr double kFirstTurn = 3.2;

// Adds a law and the state of its coordinate. A coordinate without a law, in its first turn, adds
// nothing.
void add(Fnv1a& hash, const CoordinateLaw& law, const CoordinateState& state) {
  if (law.is_none() && std::abs(state.position) <= kFirstTurn) return;
  for (const double number :
       {law.lower, law.upper, law.limit_restitution, law.friction, law.damping, law.stiffness,
        law.rest, law.zero, state.position, state.held})
    hash.add(number);
  if (state.braking != 0.0) hash.add(state.braking);
  hash.add(std::uint64_t{law.motor.has_value()});
  if (!law.motor) return;
  const Motor& motor = *law.motor;
  for (const double number :
       {motor.bias, motor.amplitude, motor.frequency, motor.phase, motor.max_force, motor.timeout,
        motor.position.value_or(0.0), motor.servo_stiffness, motor.servo_damping,
        motor.force.value_or(0.0)})
    hash.add(number);
  hash.add(std::uint64_t{motor.position.has_value()});
  hash.add(std::uint64_t{motor.force.has_value()});
}

double first_end(const Joint& joint, const JointState& state) {
  return info(joint.kind).coordinates > 0 ? state.coordinates[0].expires_at : state.expires_at;
}

void add(Fnv1a& hash, const Joint& joint, const std::string& body_a, const std::string& body_b,
         const JointData& state) {
  hash.add(joint.name);
  hash.add(std::string(name(joint.kind)));
  hash.add(body_a);
  hash.add(joint.anchor_a);
  hash.add(body_b);
  hash.add(joint.anchor_b);
  add_settings(hash, joint);
  const Motor& motor = joint.motor;
  for (const double value : {motor.bias, motor.amplitude, motor.frequency, motor.phase,
                             motor.max_force, motor.timeout, first_end(joint, state), state.travel})
    hash.add(value);
  add(hash, state.impulse);
  for (std::size_t i = 0; i < static_cast<std::size_t>(info(joint.kind).coordinates); ++i)
    add(hash, joint.coordinates[i], state.coordinates[i]);
  for (std::size_t i = 1; i < kMaxCoordinates; ++i)
    if (std::isfinite(state.coordinates[i].expires_at)) hash.add(state.coordinates[i].expires_at);
  if (joint.break_torque > 0.0) hash.add(joint.break_torque);
  if (info(joint.kind).couples)
    for (const double number :
         {joint.coupling.ratio, joint.pitch, state.coupling.constant, state.coupling_impulse})
      hash.add(number);
  hash.add(joint.baumgarte.value_or(-1.0));
  hash.add(joint.break_force);
  hash.add(std::uint64_t{joint.collide_connected});
  hash.add(std::uint64_t{state.broken});
  if (!joint.enabled) hash.add(std::string("disabled"));
  if (state.saturated) hash.add(std::string("saturated"));
  if (!state.closing) return;
  hash.add(state.to_close.since);
  if (info(joint.kind).couples) hash.add(state.to_close.coupling);
  add(hash, state.to_close.offset);
  if (closes_by_frame(forms(joint.kind))) {
    hash.add(state.to_close.shift);
    hash.add(state.to_close.turn);
    hash.add(state.closing_share);
  }
  hash.add(state.initial_error);
  for (std::size_t i = 0; i < kMaxCoordinates; ++i) {
    const MovingStart& moving = state.to_close.moving[i];
    if (moving.duration == 0.0) continue;
    hash.add(std::uint64_t{i});
    for (const double number :
         {moving.since, moving.duration, moving.offset, moving.rate, moving.acceleration})
      hash.add(number);
  }
}

void add(Fnv1a& hash, const TouchingPair& pair, const std::string& body_a,
         const std::string& body_b) {
  hash.add(body_a);
  hash.add(body_b);
  if (pair.part_a != 0 || pair.part_b != 0) {
    hash.add(pair.part_a);
    hash.add(pair.part_b);
  }
  for (std::size_t k = 0; k < static_cast<std::size_t>(pair.manifold.count); ++k) {
    hash.add(std::uint64_t{pair.manifold.points[k].feature});
    hash.add(pair.impulses[k]);
  }
}

void add(Fnv1a& hash, const IslandMemory& memory, const std::string& first_body) {
  hash.add(first_body);
  for (const std::uint64_t value :
       {memory.quiet_for, std::uint64_t{memory.is_stiff},
        static_cast<std::uint64_t>(memory.stiff_ticks), memory.stiff_until, memory.refused_until,
        memory.touched_until, memory.inconsistent_until, std::uint64_t{memory.gradient_iterations},
        std::uint64_t{memory.is_in_group}})
    hash.add(value);
  if (memory.contacts_refused_until > 0) hash.add(memory.contacts_refused_until);
  if (memory.left_for != MethodReason::kSmooth)
    hash.add(static_cast<std::uint64_t>(memory.left_for));
  hash.add(memory.substep_cost);
}

// Adds the memory of the method of each awake island. A fresh island adds its index instead, where
// its method would have continued from memory. Sleeping islands add nothing: their methods begin
// anew when they wake.
template <class Impl>
void add_methods(Fnv1a& hash, const Impl& world) {
  const MemoryHash add(&hash);
  for (std::size_t i = 0; i < world.islands.size(); ++i) {
    const Island& island = world.islands[i];
    const IslandParts& parts = world.island_parts[i];
    if (island.why == MethodReason::kAtRest) continue;
    if (parts.is_fresh) {
      if (restarts_methods(world, i)) hash.add(std::uint64_t{i});
      continue;
    }
    const List<FreeRotation>& rotations = world.integration.rotations();
    for (const int body : parts.turning_freely) {
      if (static_cast<std::size_t>(body) >= rotations.size()) continue;
      const FreeRotation& rotation = rotations[static_cast<std::size_t>(body)];
      if (!rotation.has_memory()) continue;
      add(body);
      FreeRotation::visit_memory(rotation, add);
    }
    // Sequential impulses use no IslandMotion; the next other method resets it.
    if (parts.motion < 0 || uses_impulses(island.method)) continue;
    hash.add(std::uint64_t{i});
    for (const int word : {static_cast<int>(island.method), static_cast<int>(island.why)})
      add(word);
    IslandMotion::visit_memory(world.motions[static_cast<std::size_t>(parts.motion)], add,
                               world.masses);
  }
  for (const AppliedWrench& load : world.integration.loads()) {
    const int i = world.topology.island_of(to_index(load.body));
    if (i < 0 || world.island_parts[i].is_fresh || world.islands[i].why == MethodReason::kAtRest)
      continue;
    add(load.body);
    add(load.force);
    add(load.torque);
  }
}

void add(Fnv1a& hash, const Wrench& wrench, const std::string& body, double now) {
  hash.add(body);
  hash.add(wrench.force);
  hash.add(wrench.torque);
  hash.add(std::max(wrench.start, now));  // a start in the past changes no later step
  hash.add(wrench.end);
}

}  // namespace

std::uint64_t World::state_hash() const {
  std::optional<Impl> copy;
  return compiled(*impl_, &copy).hash();
}

std::uint64_t World::Impl::hash() const {
  const Impl& world = *this;
  Fnv1a hash;
  add(hash, world.options);
  hash.add(world.step_count);
  hash.add(world.base_step);
  hash.add(world.base_time);
  const auto name_of = [&](BodyId id) -> const std::string& {
    return world.bodies[world.index(id)].name;
  };
  // Indices are hashed as well: rows are solved in the order of adding, which decides the last
  // bits.
  const List<std::size_t> body_order = by_name(world.bodies, 1);
  for (const std::size_t i : body_order) {
    hash.add(std::uint64_t{i});
    add(hash, world.bodies[i], world.masses[i], world.states[i]);
    hash.add(std::uint64_t{world.asleep[i]});
    if (world.any_corrections && !world.corrections[i].isZero(0.0))
      hash.add(world.corrections[i].data(), sizeof(Twist));
  }
  for (const std::size_t j : by_name(world.joints, 0)) {
    hash.add(std::uint64_t{j});
    add(hash, world.joints[j], name_of(world.joints[j].body_a), name_of(world.joints[j].body_b),
        world.joint_states[j]);
    if (info(world.joints[j].kind).couples_joints)
      for (const JointId id : {world.joints[j].coupling.first, world.joints[j].coupling.second})
        hash.add(world.joints[world.index(id)].name);
    if (world.self_stress[j].is_none()) continue;
    add(hash, world.self_stress[j].share);
    add(hash, world.self_stress[j].impulse);
  }
  for (const std::size_t i : body_order)
    for (const Wrench& wrench : world.wrenches)
      if (wrench.body == world.body_ids[i]) add(hash, wrench, world.bodies[i].name, world.time());
  for (const auto* pairs : {&world.touching, &world.resting})
    for (const TouchingPair& pair : *pairs)
      if (world.is_known(pair)) add(hash, pair, name_of(pair.id_a), name_of(pair.id_b));
  for (const auto& [first_body, memory] : memories_of(world))
    if (world.find(first_body) >= 0) add(hash, memory, name_of(first_body));
  add_methods(hash, world);
  return hash.value();
}

}  // namespace constraint_sim::engine
