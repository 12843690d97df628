#include <utility>

#include "engine/constraints/custom_code.h"
#include "engine/constraints/joint.h"
#include "engine/constraints/joint_kinds.h"
#include "engine/constraints/joint_load.h"
#include "engine/constraints/law.h"
#include "engine/constraints/one_sided_law.h"
#include "engine/edits/coupling_loops.h"
#include "engine/edits/issue_id.h"
#include "engine/edits/joint_defaults.h"
#include "engine/edits/joint_edits.h"
#include "engine/edits/motor_ends.h"
#include "engine/math/list.h"
#include "engine/model/fields.h"
#include "engine/model/validate.h"
#include "engine/world/world_impl.h"

namespace constraint_sim::engine {

using Eigen::Vector3d;

namespace {

void check_ends(const Model& model, const Joint& joint) {
  const std::size_t a = model.index(joint.body_a);
  const std::size_t b = model.index(joint.body_b);
  const std::string names =
      in_quotes(model.bodies[a].name) + " and " + in_quotes(model.bodies[b].name);
  if (a == b) refuse("body_b", "must be another body than body_a, got " + names);
  if (!model.is_movable(a) && !model.is_movable(b))
    refuse("body_b", "one of the two bodies must be dynamic, got " + names);
  const auto check_anchor = [&](const char* field, std::size_t i, const Vector3d& anchor) {
    const bool cannot_turn = model.is_movable(i) && model.masses[i].inertia.isZero(0.0);
    if (cannot_turn && !anchor.isZero(0.0))
      refuse(field, in_quotes(model.bodies[i].name) +
                        " is a point mass without inertia, its anchor must be (0, 0, 0), got " +
                        shown(anchor));
  };
  check_anchor("anchor_a", a, joint.anchor_a);
  check_anchor("anchor_b", b, joint.anchor_b);
  const JointForms& kind = forms(joint.kind);
  const auto check_axes = [&](const char* field, std::size_t i, bool has_axes) {
    if (has_axes && model.is_movable(i) && !model.masses[i].can_turn())
      refuse(field, in_quotes(model.bodies[i].name) +
                        " is a point mass without inertia and has no axes, " +
                        "which a joint of type " + kind.name + " needs");
  };
  check_axes("body_a", a, kind.has_frames);
  check_axes("body_b", b, turns_b(kind));
}

/// Refuses a gear, pulley or screw on a joint without the coordinate that it couples: a free
/// length, or the first coordinate of the joint.
void check_coupling(const Model& model, const State& state, const Joint& joint, bool broken) {
  const Coupling& coupling = joint.coupling;
  const auto check = [&](JointId id) {
    const Joint& of = model.joints[model.index(id)];
    const bool fits = info(joint.kind).couples_lengths ? info(of.kind).is_free_length
                                                       : info(of.kind).coordinates > 0;
    if (!fits)
      refuse("joints", in_quotes(of.name) + " is of type " + name(of.kind) + ", a " +
                           name(joint.kind) +
                           (info(joint.kind).couples_lengths
                                ? " joins distance constraints with free: true"
                                : " joins constraints with a free coordinate, such as hinges"));
    if (!broken && state.joint_states[model.index(id)].broken)
      refuse("joints", in_quotes(of.name) + " is broken");
    if (joint.enabled && !of.enabled) refuse("joints", in_quotes(of.name) + " is disabled");
  };
  check(coupling.first);
  check(coupling.second);
  if (coupling.first == coupling.second)
    refuse("joints", "must be two constraints, got " +
                         in_quotes(model.joints[model.index(coupling.first)].name) + " twice");
}

BodyId movable_end(const Model& model, JointId id) {
  const Joint& joint = model.joints[model.index(id)];
  return model.is_movable(model.index(joint.body_b)) ? joint.body_b : joint.body_a;
}

void check_coordinate(const char* field, const Joint& joint, int coordinate) {
  if (coordinate >= 0 && coordinate < info(joint.kind).coordinates) return;
  refuse(field, "a " + std::string(name(joint.kind)) + " joint has no coordinate " +
                    std::to_string(coordinate) + " with a law");
}

}  // namespace

JointId World::add_joint(const Joint& joint, bool broken) {
  return impl_->add_joint(joint, broken, false);
}

JointId World::Impl::add_joint(const Joint& joint, bool broken, bool is_saved) {
  validate(joint);
  if (info(joint.kind).couples_joints && joint.enabled && !broken && !is_saved)
    check_coupling_loop(*this, *this, joint);
  if (joint_by_name.count(joint.name) > 0)
    refuse("name", "there is already a constraint named " + in_quotes(joint.name));
  Joint filled = joint;
  if (info(joint.kind).couples_joints) {
    check_coupling(*this, *this, joint, broken);
    filled.body_a = movable_end(*this, joint.coupling.first);
    filled.body_b = movable_end(*this, joint.coupling.second);
    filled.anchor_a.setZero();
    filled.anchor_b.setZero();
  } else {
    check_ends(*this, joint);
  }
  fill_in(*this, *this, &filled);
  if (info(filled.kind).is_custom) {
    make_custom_code(&filled);
    if (!is_saved)
      filled.custom.code->check(
          JointVectors(filled, states[index(filled.body_a)], states[index(filled.body_b)]));
  }

  const JointId id = issue(&next_joint_id);
  joints.push_back(filled);
  joint_starts.push_back({filled.motor, filled.coordinates, broken, filled.enabled, {}, 0.0});
  joint_states.emplace_back();
  self_stress.emplace_back();
  JointEdits(this, joints.size() - 1).start();
  wake_ends(filled);
  joint_ids.push_back(id);
  joint_by_name.emplace(joint.name, id);
  joints_of_bodies = {};
  edits.note_topology();
  return id;
}

// Returns the joints with a body among their holders(), by index. Lists all bodies on first use.
const List<std::size_t>& World::Impl::joints_on(std::size_t body) {
  if (joints_of_bodies.get() == nullptr) {
    joints_of_bodies.make();
    joints_of_bodies->resize(bodies.size());
    for (std::size_t j = 0; j < joints.size(); ++j)
      for (const BodyId id : holders(j)) {
        List<std::size_t>& list = (*joints_of_bodies.get())[index(id)];
        if (list.empty() || list.back() != j) list.push_back(j);
      }
  }
  static const List<std::size_t> kNone;
  return body < joints_of_bodies->size() ? (*joints_of_bodies.get())[body] : kNone;
}

void World::Impl::wake_ends(const Joint& joint) {
  sleep.wake(index(joint.body_a), this);
  sleep.wake(index(joint.body_b), this);
}

void World::set_motor(JointId id, const Motor& motor) {
  if (info(joint(id).kind).coordinates > 0) return set_motor(id, 0, motor);
  const std::size_t j = impl_->index(id);
  Joint joint = impl_->joints[j];
  joint.motor = motor;
  validate(joint);
  if (motor.timeout == 0.0 && are_same(motor, impl_->joints[j].motor)) return;

  impl_->wake_ends(joint);
  if (is_always_rigid(joint) != is_always_rigid(impl_->joints[j]))
    impl_->edits.note_topology();  // only rigid joints close loops
  const bool was_one_sided = has_one_sided_law(std::exchange(impl_->joints[j], joint));
  set_ends(joint, time(), &impl_->joint_states[j]);
  if (was_one_sided || has_one_sided_law(joint)) return impl_->edits.note_laws_of(*impl_, joint);
  impl_->edits.note_islands_of(*impl_, joint);
}

void World::set_motor(JointId id, int coordinate, const std::optional<Motor>& motor) {
  check_coordinate("motor", joint(id), coordinate);
  CoordinateLaw law = joint(id).coordinates[static_cast<std::size_t>(coordinate)];
  law.motor = motor;
  JointEdits(impl_.get(), impl_->index(id)).set_law(to_index(coordinate), law, true);
}

void World::set_law(JointId id, int coordinate, const CoordinateLaw& law) {
  check_coordinate("coordinate", joint(id), coordinate);
  CoordinateLaw changed = law;
  const CoordinateLaw& before = joint(id).coordinates[static_cast<std::size_t>(coordinate)];
  if (!law.position) changed.zero = before.zero;
  JointEdits(impl_.get(), impl_->index(id))
      .set_law(to_index(coordinate), changed, law.motor.has_value() != before.motor.has_value());
}

void World::set_broken(JointId id, bool broken) {
  const std::size_t j = impl_->index(id);
  const Joint& joint = impl_->joints[j];
  if (!broken && info(joint.kind).couples_joints)
    for (const JointId coupled : {joint.coupling.first, joint.coupling.second})
      if (joint_state(coupled).broken)
        refuse("name", in_quotes(this->joint(coupled).name) + ", which " + in_quotes(joint.name) +
                           " couples, is broken");
  if (broken)
    for (const std::size_t coupling : impl_->couplings_of(j))
      set_broken(impl_->joint_ids[coupling], true);
  impl_->joint_states[j].broken = broken;
  JointEdits(impl_.get(), j).restart();
}

}  // namespace constraint_sim::engine
