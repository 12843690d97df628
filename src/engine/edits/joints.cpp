#include <algorithm>
#include <limits>

#include "engine/constraints/distance.h"
#include "engine/constraints/joint.h"
#include "engine/edits/find_named.h"
#include "engine/validate.h"
#include "engine/world_impl.h"

namespace constraint_sim::engine {
namespace {

using Eigen::Vector3d;

constexpr double kCoincident = 1e-9;  // of the anchors' coordinates: nearer than this is one point
constexpr double kPi = 3.14159265358979323846;

}  // namespace

std::size_t World::Impl::index(JointId id) const {
  const bool known = id.value < joint_index.size() && joint_index[id.value] >= 0;
  if (!known) refuse("constraint", "there is none with id " + std::to_string(id.value));
  return static_cast<std::size_t>(joint_index[id.value]);
}

JointId World::add_joint(const Joint& joint, bool broken) {
  validate(joint);
  if (has_joint(joint.name))
    refuse("name", "there is already a constraint named " + quoted(joint.name));
  impl_->check_ends(joint);
  Joint filled = joint;
  impl_->fill_in(filled);

  const JointId id{static_cast<std::uint32_t>(impl_->joint_index.size())};
  impl_->joint_index.push_back(static_cast<int>(impl_->joints.size()));
  impl_->joints.push_back(filled);
  impl_->joint_starts.push_back({filled.motor, broken, {}, 0.0});
  impl_->joint_states.emplace_back();
  impl_->self_stress.emplace_back();
  impl_->start_joint(impl_->joints.size() - 1);
  impl_->wake_ends(filled);
  impl_->joint_ids.push_back(id);
  impl_->joint_by_name.emplace(joint.name, id);
  impl_->edited = impl_->topology_edited = true;
  return id;
}

void World::Impl::check_ends(const Joint& joint) const {
  const std::size_t a = index(joint.body_a);
  const std::size_t b = index(joint.body_b);
  const std::string names = quoted(bodies[a].name) + " and " + quoted(bodies[b].name);
  if (a == b) refuse("body_b", "must be another body than body_a, got " + names);
  if (!is_movable(a) && !is_movable(b))
    refuse("body_b", "one of the two bodies must be dynamic, got " + names);
  const auto check_anchor = [&](const char* field, std::size_t i, const Vector3d& anchor) {
    const bool cannot_turn = is_movable(i) && masses[i].inertia.isZero(0.0);
    if (cannot_turn && !anchor.isZero(0.0))
      refuse(field, quoted(bodies[i].name) +
                        " is a point mass without inertia, its anchor must be (0, 0, 0), got " +
                        shown(anchor));
  };
  check_anchor("anchor_a", a, joint.anchor_a);
  check_anchor("anchor_b", b, joint.anchor_b);
}

// the length as it is, the ball joint that a length of zero asks for, and a spring's constants
void World::Impl::fill_in(Joint& joint) const {
  auto* distance = std::get_if<DistanceJoint>(&joint.type);
  if (distance == nullptr) return;
  const std::size_t a = index(joint.body_a);
  const std::size_t b = index(joint.body_b);
  const AnchorPair anchors(joint, states[a], states[b]);

  if (!is_between_limits(*distance) && !distance->length) {
    const double size = std::max({anchors.p_A.norm(), anchors.r_A.norm(), anchors.r_B.norm()});
    const double present = anchors.d.norm();
    distance->length = present <= kCoincident * size ? 0.0 : present;
  }
  if (distance->length == 0.0 && !distance->is_soft()) {
    joint.type = BallJoint{};
  } else if (distance->frequency > 0.0) {
    const Jacobian J = anchors.along(direction(anchors));
    const double constraint_mass = inverse_mass_along(J, a, b);
    const double omega = 2.0 * kPi * distance->frequency;
    distance->stiffness = omega * omega / constraint_mass;
    distance->damping = 2.0 * distance->damping_ratio * omega / constraint_mass;
    distance->frequency = distance->damping_ratio = 0.0;
  }
  validate(joint);  // a ball joint has no motor, and what followed from the rest may be too large
}

// J M⁻¹ Jᵀ of one row between two bodies
double World::Impl::inverse_mass_along(const Jacobian& J, std::size_t a, std::size_t b) const {
  const auto turning = [&](std::size_t i, const Vector3d& j) {
    const Vector3d j_B = states[i].orientation.conjugate() * j;
    return j_B.dot(masses[i].inverse_inertia.cwiseProduct(j_B));
  };
  return masses[a].inverse_mass * J.j1.squaredNorm() + turning(a, J.j2) +
         masses[b].inverse_mass * J.j3.squaredNorm() + turning(b, J.j4);
}

// the state of a joint just added
void World::Impl::start_joint(std::size_t j) {
  JointState& state = joint_states[j] = JointState{};
  state.broken = joint_starts[j].broken;
  self_stress[j] = SelfStress{};
  state.expires_at = end_of(joints[j].motor);
  begin_joint(joints[j], states[index(joints[j].body_a)], states[index(joints[j].body_b)], time(),
              state);
  if (!joint_starts[j].state) return;
  state = *joint_starts[j].state;
  const double elapsed = time() - joint_starts[j].time;
  state.expires_at += elapsed;
  state.closing_since += elapsed;
}

// the state of a joint that goes on as it was saved
void World::Impl::continue_joint(std::size_t j, const JointState& saved) {
  JointState& state = joint_states[j];
  state.travel = saved.travel;
  state.expires_at = saved.expires_at;
  state.impulse = saved.impulse;
  begin_joint(joints[j], states[index(joints[j].body_a)], states[index(joints[j].body_b)], time(),
              state);  // measures it with this travel
  state.closing = saved.closing && is_rigid(joints[j]) && !state.broken;
  if (state.closing) {
    state.closing_since = saved.closing_since;
    state.closing_offset = saved.closing_offset;
    state.initial_error = saved.initial_error;
  }
  joint_starts[j].state = state;
  joint_starts[j].time = time();
  edited = true;
}

// whether a joint added now, as this one is, would begin with the same state
bool World::Impl::is_as_added(JointId id) const {
  const std::size_t j = index(id);
  const Joint& joint = joints[j];
  const JointState& state = joint_states[j];
  JointState added;
  added.broken = state.broken;
  begin_joint(joint, states[index(joint.body_a)], states[index(joint.body_b)], time(), added);
  const bool closes_alike = !added.closing || (state.closing_since == added.closing_since &&
                                               state.closing_offset == added.closing_offset &&
                                               state.initial_error == added.initial_error);
  return state.travel == 0.0 && state.impulse.isZero(0.0) &&
         state.expires_at == end_of(joint.motor) && state.closing == added.closing &&
         closes_alike && self_stress[j].is_none();
}

// when a motor set now loses its bias
double World::Impl::end_of(const Motor& motor) const {
  return motor.timeout > 0.0 ? time() + motor.timeout : std::numeric_limits<double>::infinity();
}

void World::Impl::wake_ends(const Joint& joint) {
  wake(index(joint.body_a));
  wake(index(joint.body_b));
}

void World::Impl::erase_joint(std::size_t j) {
  wake_ends(joints[j]);
  const auto at = static_cast<std::ptrdiff_t>(j);
  joint_index[joint_ids[j].value] = -1;
  joint_by_name.erase(joints[j].name);
  joints.erase(joints.begin() + at);
  joint_starts.erase(joint_starts.begin() + at);
  joint_states.erase(joint_states.begin() + at);
  self_stress.erase(self_stress.begin() + at);
  joint_ids.erase(joint_ids.begin() + at);
  for (std::size_t k = j; k < joint_ids.size(); ++k) --joint_index[joint_ids[k].value];
  edited = topology_edited = true;
}

void World::remove_joint(JointId id) { impl_->erase_joint(impl_->index(id)); }

bool World::has_joint(std::string_view name) const {
  return impl_->joint_by_name.count(std::string(name)) > 0;
}

JointId World::find_joint(std::string_view name) const {
  return find_named(impl_->joint_by_name, name, "constraint");
}

const std::vector<JointId>& World::joint_ids() const { return impl_->joint_ids; }
const Joint& World::joint(JointId id) const { return impl_->joints[impl_->index(id)]; }
const JointState& World::joint_state(JointId id) const {
  return impl_->joint_states[impl_->index(id)];
}

World::Anchors World::anchors(JointId id) const {
  const Joint& joint = this->joint(id);
  const AnchorPair pair(joint, state(joint.body_a), state(joint.body_b));
  return {pair.p_A, pair.p_A + pair.d};
}

void World::set_motor(JointId id, const Motor& motor) {
  const std::size_t j = impl_->index(id);
  Joint joint = impl_->joints[j];
  joint.motor = motor;
  validate(joint);

  impl_->wake_ends(joint);
  impl_->joints[j] = joint;
  impl_->joint_states[j].expires_at = impl_->end_of(motor);
  impl_->edited = true;
}

void World::set_broken(JointId id, bool broken) {
  const Joint& joint = this->joint(id);
  JointState& state = impl_->joint_states[impl_->index(id)];
  state.broken = broken;
  state.impulse.setZero();
  impl_->wake_ends(joint);
  begin_joint(joint, this->state(joint.body_a), this->state(joint.body_b), time(), state);
  impl_->edited = impl_->topology_edited = true;
}

}  // namespace constraint_sim::engine
