// Settings of a joint changed while it acts: laws, springs, limits, motors, and whether it acts.

#include <algorithm>
#include <tuple>

#include "engine/constraints/joint.h"
#include "engine/constraints/joint_kinds.h"
#include "engine/edits/coupling_loops.h"
#include "engine/edits/joint_defaults.h"
#include "engine/edits/joint_edits.h"
#include "engine/edits/motor_ends.h"
#include "engine/model/fields.h"
#include "engine/model/validate.h"
#include "engine/world/world_impl.h"

namespace constraint_sim::engine {
namespace {

bool have_same_length(const DistanceJoint& a, const DistanceJoint& b) {
  return std::tie(a.length, a.min_length, a.max_length) ==
         std::tie(b.length, b.min_length, b.max_length);
}

// Clears stiffness and damping that followed from the old frequency, so that they follow from the
// new frequency.
template <class Spring>
void replace_spring(const Spring& before, Spring* spring) {
  if (spring->frequency == 0.0 || spring->stiffness != before.stiffness ||
      spring->damping != before.damping)
    return;
  spring->stiffness = spring->damping = 0.0;
}

void replace_servo(const std::optional<Motor>& before, Motor* motor) {
  if (motor->servo_frequency == 0.0 || !before ||
      motor->servo_stiffness != before->servo_stiffness ||
      motor->servo_damping != before->servo_damping)
    return;
  motor->servo_stiffness = motor->servo_damping = 0.0;
}

void check_same_place(const Joint& joint, const Joint& before) {
  const auto check = [](const char* field, bool is_same) {
    if (!is_same) refuse(field, "cannot be changed; remove the constraint and add another");
  };
  check("name", joint.name == before.name);
  check("type", joint.kind == before.kind);
  check("body_a", joint.body_a == before.body_a);
  check("body_b", joint.body_b == before.body_b);
  check("anchor_a", joint.anchor_a == before.anchor_a);
  check("anchor_b", joint.anchor_b == before.anchor_b);
  check("frame_a", joint.frame_a.coeffs() == before.frame_a.coeffs());
  const bool has_frame = before.frame_b.has_value();
  check("frame_b", joint.frame_b.has_value() == has_frame &&
                       (!has_frame || joint.frame_b->coeffs() == before.frame_b->coeffs()));
  check("joints", joint.coupling.first == before.coupling.first &&
                      joint.coupling.second == before.coupling.second);
  check("ratio", joint.coupling.ratio == before.coupling.ratio);
  check("one_sided", joint.coupling.one_sided == before.coupling.one_sided);
  check("value", joint.coupling.value == before.coupling.value);
  check("pitch", joint.pitch == before.pitch);
  check("custom", joint.custom.type == before.custom.type);
  const auto is_same = [](const CustomParameter& a, const CustomParameter& b) {
    return a.name == b.name && a.value == b.value;
  };
  const CustomParameters &now = joint.custom.parameters, &then = before.custom.parameters;
  check("parameters", std::equal(now.begin(), now.end(), then.begin(), then.end(), is_same));
}

/// Checks that joints stay enabled as long as an enabled coupling couples them.
void check_coupled_act(const Model& model, std::size_t j, bool enabled) {
  if (enabled && info(model.joints[j].kind).couples_joints)
    for (const JointId id : {model.joints[j].coupling.first, model.joints[j].coupling.second})
      if (!model.joints[model.index(id)].enabled)
        refuse("enabled",
               in_quotes(model.joints[model.index(id)].name) + ", which it couples, is disabled");
  if (enabled) return;
  for (const std::size_t coupling : model.couplings_of(j))
    if (model.joints[coupling].enabled)
      refuse("enabled",
             "it is coupled by " + in_quotes(model.joints[coupling].name) + ", disable that first");
}

}  // namespace

void World::set_joint(JointId id, const Joint& joint) {
  const std::size_t j = impl_->index(id);
  const Joint before = impl_->joints[j];
  Joint changed = joint;
  clear_unused(&changed);
  check_same_place(changed, before);
  changed.custom = before.custom;  // with its functions, which callers need not have
  replace_spring(before.distance, &changed.distance);
  JointEdits::LawChanges changes{};
  for (std::size_t i = 0; i < changes.size(); ++i) {
    CoordinateLaw& law = changed.coordinates[i];
    changes[i] = {!are_same(law, before.coordinates[i]),
                  !are_same(law.motor, before.coordinates[i].motor)};
    replace_spring(before.coordinates[i], &law);
    if (law.motor) replace_servo(before.coordinates[i].motor, &*law.motor);
  }
  validate(changed);
  if (changed.enabled != before.enabled) check_coupled_act(*impl_, j, changed.enabled);
  if (changed.enabled && !before.enabled && info(joint.kind).couples_joints)
    check_coupling_loop(*impl_, *impl_, changed);
  const bool is_distance = has_length(joint.kind);
  if (is_distance) {
    fill_in(*impl_, *impl_, &changed);
    if (changed.kind != joint.kind)
      refuse("length", "a rod does not become a ball joint; remove it and add another, got 0");
  } else {
    set_zeros(*impl_, *impl_, &changed);
    fill_in_laws(*impl_, *impl_, &changed);
  }

  JointEdits edits(impl_.get(), j);
  edits.replace(changed, changes);
  impl_->edits.note_laws_of(*impl_, changed);
  JointData& state = impl_->joint_states[j];
  if (is_distance && !are_same(changed.motor, before.motor))
    state.expires_at = end_of(changed.motor, time());
  const bool is_resized = is_distance && !have_same_length(changed.distance, before.distance);
  if (is_resized) state.travel = 0.0;
  const bool is_another_law = changed.distance.one_sided != before.distance.one_sided ||
                              is_rigid(changed) != is_rigid(before);
  // reset() returns to a saved state only with the length and the law that it belongs to
  if (is_resized || is_another_law) impl_->joint_starts[j].state.reset();
  if (is_resized || is_another_law || changed.enabled != before.enabled) edits.restart();
  if (changed.enabled && !before.enabled) edits.hold_from_here();
}

void World::set_enabled(JointId id, bool enabled) {
  Joint changed = joint(id);
  if (changed.enabled == enabled) return;
  changed.enabled = enabled;
  set_joint(id, changed);
}

}  // namespace constraint_sim::engine
