#include "engine/edits/joint_edits.h"

#include <algorithm>
#include <tuple>
#include <utility>

#include "engine/constraints/closing_errors.h"
#include "engine/constraints/coupling.h"
#include "engine/constraints/joint.h"
#include "engine/constraints/joint_kinds.h"
#include "engine/constraints/law.h"
#include "engine/edits/joint_defaults.h"
#include "engine/edits/motor_ends.h"
#include "engine/islands/coordinate_motions.h"
#include "engine/math/list.h"
#include "engine/math/numbers.h"
#include "engine/model/fields.h"
#include "engine/model/validate.h"
#include "engine/world/world_impl.h"

namespace constraint_sim::engine {
namespace {

/// Whether a coordinate is held and limited alike by both laws, whose springs, dampers, servos or
/// constant forces have other numbers.
bool differ_in_force_alone(const CoordinateLaw& a, const CoordinateLaw& b) {
  if (a.motor.has_value() != b.motor.has_value() || a.zero != b.zero) return false;
  if (a.motor) {
    const Motor &of_a = *a.motor, &of_b = *b.motor;
    const auto may_jump = [](const Motor& of) { return of.is_rigid() || of.timeout > 0; };
    if (may_jump(of_a) || may_jump(of_b)) return false;
    if (of_a.is_servo() != of_b.is_servo() || of_a.max_force != of_b.max_force) return false;
  }
  if (soft_law(a).is_none() != soft_law(b).is_none()) return false;
  const auto one_sided = [](const CoordinateLaw& of) {
    return std::tie(of.lower, of.upper, of.limit_restitution, of.friction);
  };
  return one_sided(a) == one_sided(b);
}

/// Whether a coordinate is beyond a limit that has changed.
bool is_beyond_new_limits(const Joint& joint, const Joint& before, const JointState& state) {
  for (std::size_t i = 0; i < to_index(info(joint.kind).coordinates); ++i) {
    const CoordinateLaw &law = joint.coordinates[i], &old = before.coordinates[i];
    if (law.lower == old.lower && law.upper == old.upper) continue;
    if (beyond_limits(law, state.coordinates[i].position) != 0.0) return true;
  }
  return false;
}

}  // namespace

void JointEdits::start() {
  const Joint& joint = world_.joints[j_];
  const JointStart& start = world_.joint_starts[j_];
  const double now = world_.time();
  JointData& state = world_.joint_states[j_] = JointData{};
  state.broken = start.broken;
  world_.self_stress[j_] = SelfStress{};
  set_ends(joint, now, &state);
  const std::size_t a = world_.index(joint.body_a), b = world_.index(joint.body_b);
  const MassProperties &mass_a = world_.masses[a], &mass_b = world_.masses[b];
  const double radius = std::max(mass_a.radius_of_gyration(), mass_b.radius_of_gyration());
  state.radius = radius;
  if (info(joint.kind).couples_joints)
    read_coupling(world_.terms_of(j_), world_.joint_states, &state.coupling);
  begin_coordinates(joint, world_.states[a], world_.states[b], state);
  begin_joint(joint, world_.states[a], world_.states[b], now, state, mass_b.can_turn());
  if (start.state) {
    state = *start.state;
    state.radius = radius;  // set_body() may have changed the bodies since
    const double elapsed = now - start.time;
    visit_motors(joint, state, [&](const Motor&, double& end) { end += elapsed; });
    visit_starts(state.to_close, [&](double& since) { since += elapsed; });
  }
  if (info(joint.kind).couples_joints) end_with_coupled(joint.coupling);
}

void JointEdits::end_with_coupled(const Coupling& coupling) {
  const bool acted = acts(world_.joints[j_], world_.joint_states[j_]);
  for (const JointId id : {coupling.first, coupling.second}) {
    const std::size_t coupled = world_.index(id);
    if (!world_.joints[coupled].enabled) world_.joints[j_].enabled = false;
    if (world_.joint_states[coupled].broken) world_.joint_states[j_].broken = true;
  }
  if (acted && !acts(world_.joints[j_], world_.joint_states[j_])) restart();
}

void JointEdits::replace(const Joint& joint, const LawChanges& changes) {
  world_.wake_ends(joint);
  if (is_always_rigid(joint) != is_always_rigid(world_.joints[j_]))
    world_.edits.note_topology();  // only rigid joints close loops
  const CoordinateMotions motions(world_, world_, j_);
  const Joint before = std::exchange(world_.joints[j_], joint);
  CoordinateMotions::Flags is_sent{};
  for (std::size_t i = 0; i < changes.size(); ++i)
    if (changes[i].law) is_sent[i] = follow_law(i, before.coordinates[i], changes[i].motor);
  if (std::find(is_sent.begin(), is_sent.end(), true) != is_sent.end()) {
    JointData& state = world_.joint_states[j_];
    const JointStep now = joint_step(world_.options, world_.time(), world_.options.time_step);
    if (goes_on_closing(state, now.t, now.closing_time))
      measure_joint(joint, world_.states[world_.index(joint.body_a)],
                    world_.states[world_.index(joint.body_b)], now, state);
    else
      begin_closing(world_, j_, world_.time(), &world_);
    motions.send(world_, is_sent, &world_);
  } else if (is_beyond_new_limits(joint, before, world_.joint_states[j_])) {
    begin_closing(world_, j_, world_.time(), &world_);
  }
}

bool JointEdits::follow_law(std::size_t i, const CoordinateLaw& before, bool is_motor_set) {
  const CoordinateLaw& law = world_.joints[j_].coordinates[i];
  CoordinateState& coordinate = world_.joint_states[j_].coordinates[i];
  coordinate.position += law.zero - before.zero;
  coordinate.held += law.zero - before.zero;
  shift_couplings(static_cast<int>(i), law.zero - before.zero);
  if (is_motor_set)
    coordinate.expires_at = law.motor ? end_of(*law.motor, world_.time()) : kInfinity;
  const bool is_position = law.motor && law.motor->position && law.motor->is_rigid();
  if (is_position && law.zero == before.zero && are_same(law.motor, before.motor)) return false;
  if (!(before.motor && before.motor->is_rigid() && !before.motor->position))
    coordinate.held = coordinate.position;
  coordinate.braking = 0.0;
  if (!is_position) return false;
  coordinate.held = *law.motor->position;
  return true;
}

void JointEdits::shift_couplings(int coordinate, double change) {
  if (change == 0.0) return;
  List<std::size_t> affected = world_.couplings_of(j_);
  if (info(world_.joints[j_].kind).has_pitch) affected.push_back(j_);
  for (const std::size_t coupling : affected)
    for (const CoupledTerm& term : world_.terms_of(coupling))
      if (term.joint == j_ && term.coordinate == coordinate) {
        world_.joint_states[coupling].coupling.value += term.ratio * change;
        world_.joint_states[coupling].coupling.constant += term.ratio * change;
      }
}

void JointEdits::set_law(std::size_t i, const CoordinateLaw& law, bool is_motor_set) {
  Joint joint = world_.joints[j_];
  joint.coordinates[i] = law;
  validate(joint);
  set_zeros(world_, world_, &joint);
  fill_in_laws(world_, world_, &joint);
  // A repeated target changes nothing: a motor that began anew each time would never reach it.
  if (are_same(joint.coordinates[i], world_.joints[j_].coordinates[i])) {
    const std::optional<Motor>& motor = joint.coordinates[i].motor;
    const bool has_timeout = is_motor_set && motor && motor->timeout > 0.0;
    if (!has_timeout) return;
    if (motor->position) {
      world_.joint_states[j_].coordinates[i].expires_at = end_of(*motor, world_.time());
      return;
    }
  }
  LawChanges changes{};
  changes[i] = {true, is_motor_set};
  const bool is_force_alone =
      differ_in_force_alone(joint.coordinates[i], world_.joints[j_].coordinates[i]);
  replace(joint, changes);
  if (is_force_alone)
    world_.edits.note_forces_of(world_, joint);
  else
    world_.edits.note_laws_of(world_, joint);
}

void JointEdits::restart() {
  const Joint& joint = world_.joints[j_];
  JointData& state = world_.joint_states[j_];
  forget_impulses(&state);
  world_.self_stress[j_] = SelfStress{};
  world_.wake_ends(joint);
  begin_closing(world_, j_, world_.time(), &world_);
  world_.edits.note_topology();
  world_.edits.note_islands_of(world_, joint);
}

void JointEdits::hold_from_here() {
  const Joint& joint = world_.joints[j_];
  JointData& state = world_.joint_states[j_];
  bool is_held = false;
  for (std::size_t i = 0; i < static_cast<std::size_t>(info(joint.kind).coordinates); ++i) {
    const std::optional<Motor>& motor = joint.coordinates[i].motor;
    if (!motor || !motor->is_rigid() || motor->position) continue;
    state.coordinates[i].held = state.coordinates[i].position;
    is_held = true;
  }
  if (is_held) begin_closing(world_, j_, world_.time(), &world_);
}

}  // namespace constraint_sim::engine
