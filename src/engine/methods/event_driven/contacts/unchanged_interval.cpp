#include "engine/methods/event_driven/contacts/unchanged_interval.h"

#include <algorithm>
#include <type_traits>

#include "engine/math/same_bits.h"
#include "engine/model/fields.h"

namespace constraint_sim::engine {
namespace {

bool are_same(const BodyState& l, const BodyState& r) {
  return have_same_bits(l.position, r.position) &&
         have_same_bits(l.orientation.coeffs(), r.orientation.coeffs()) &&
         have_same_bits(l.linear_velocity, r.linear_velocity) &&
         have_same_bits(l.angular_velocity, r.angular_velocity);
}

bool are_same(const std::optional<ShapePose>& l, const std::optional<ShapePose>& r) {
  if (!l || !r) return !l && !r;
  return have_same_bits(l->position, r->position) &&
         have_same_bits(l->orientation.coeffs(), r->orientation.coeffs());
}

bool are_same(const GroupBody& l, const GroupBody& r) {
  return l.index == r.index && l.mass.inverse_mass == r.mass.inverse_mass &&
         l.mass.inertia == r.mass.inertia && l.mass.inverse_inertia == r.mass.inverse_inertia &&
         l.mass.weight_share == r.mass.weight_share && have_same_bits(l.force, r.force) &&
         have_same_bits(l.torque, r.torque);
}

bool are_same(const GroupShape& l, const GroupShape& r) {
  return l.body == r.body && l.part == r.part && are_same(l.pose, r.pose);
}

bool are_same(const Shape& l, const Shape& r) {
  const auto are_equal = [&](const auto& shape) {
    return engine::are_same(shape, std::get<std::decay_t<decltype(shape)>>(r));
  };
  return l.index() == r.index() && std::visit(are_equal, l);
}

// The state at the end of the previous step matters for reports of events alone.
bool are_same(const ContactPair& l, const ContactPair& r) {
  return l.shape_index_a == r.shape_index_a && l.shape_index_b == r.shape_index_b &&
         l.friction == r.friction && l.restitution == r.restitution &&
         are_same(l.shape_a, r.shape_a) && are_same(l.shape_b, r.shape_b);
}

bool are_same(const std::optional<Eigen::Quaterniond>& l,
              const std::optional<Eigen::Quaterniond>& r) {
  return l && r ? have_same_bits(l->coeffs(), r->coeffs()) : l.has_value() == r.has_value();
}

bool are_same(const Joint& l, const Joint& r) {
  return l.kind == r.kind && have_same_bits(l.anchor_a, r.anchor_a) &&
         have_same_bits(l.frame_a.coeffs(), r.frame_a.coeffs()) &&
         have_same_bits(l.anchor_b, r.anchor_b) && are_same(l.frame_b, r.frame_b) &&
         engine::are_same(l.distance, r.distance) && engine::are_same(l.motor, r.motor) &&
         std::equal(l.coordinates.begin(), l.coordinates.end(), r.coordinates.begin(),
                    [](const auto& a, const auto& b) { return engine::are_same(a, b); }) &&
         l.coupling.ratio == r.coupling.ratio && l.coupling.one_sided == r.coupling.one_sided &&
         l.pitch == r.pitch && l.break_force == r.break_force && l.break_torque == r.break_torque;
}

bool are_same(const CoupledTerm& l, const CoupledTerm& r) {
  return l.joint == r.joint && l.coordinate == r.coordinate && l.ratio == r.ratio;
}

bool are_same(const GroupJoint& l, const GroupJoint& r) {
  return l.index == r.index && l.a == r.a && l.b == r.b && l.has_rows == r.has_rows &&
         are_same(l.terms[0], r.terms[0]) && are_same(l.terms[1], r.terms[1]) &&
         are_same(l.joint, r.joint);
}

template <class Container>
bool are_all_same(const Container& l, const Container& r) {
  return std::equal(l.begin(), l.end(), r.begin(), r.end(),
                    [](const auto& a, const auto& b) { return are_same(a, b); });
}

// Lists the numbers that an interval begins with, beside settings.
void list_numbers(const ContactEquations& equations, List<double>* numbers) {
  *numbers = equations.bodies().numbers();
  equations.joints().add_numbers(equations.bodies(), numbers);
}

}  // namespace

bool UnchangedInterval::is_repeated_by(const Interval& interval, const ContactEquations& equations,
                                       const List<ContactPair>& pairs) {
  const GroupBodies& bodies = equations.bodies();
  const GroupJoints& joints = equations.joints();
  if (!is_known_ || bodies.has_movers() || interval.h != h_ || !joints.are_at_rest() ||
      !have_same_bits(interval.gravity, gravity_) || !are_all_same(bodies.list(), bodies_) ||
      !are_all_same(bodies.shapes().list(), shapes_) || !are_all_same(pairs, pairs_) ||
      !are_all_same(joints.list(), joints_))
    return false;
  list_numbers(equations, &numbers_now_);
  if (numbers_now_.size() != numbers_.size() ||
      !have_same_bits(numbers_now_.data(), numbers_.data(), numbers_.size()))
    return false;
  for (std::size_t i = bodies.movable(); i < states_.size(); ++i)
    if (!are_same(bodies.state(i), states_[i])) return false;
  return true;
}

void UnchangedInterval::begin(const Interval& interval, const ContactEquations& equations,
                              const List<ContactPair>& pairs) {
  const GroupBodies& bodies = equations.bodies();
  is_known_ = false;
  gravity_ = interval.gravity;
  h_ = interval.h;
  list_numbers(equations, &numbers_);
  bodies_ = bodies.list();
  shapes_ = bodies.shapes().list();
  pairs_ = pairs;
}

void UnchangedInterval::end(const ContactEquations& equations, const IntegrationResult& progress,
                            double work) {
  is_known_ = true;
  progress_ = progress;
  work_ = work;
  states_ = equations.bodies().states();
  contacts_ = equations.contacts();
  joints_ = equations.joints().list();
  coordinates_ = equations.joints().coordinates();
}

void UnchangedInterval::repeat(ContactEquations* equations) const {
  GroupJoints& joints = equations->joints();
  for (std::size_t j = 0; j < joints_.size(); ++j) joints.list()[j].impulse = joints_[j].impulse;
  for (std::size_t c = 0; c < coordinates_.size(); ++c) {
    GroupCoordinate& of = joints.coordinates()[c];
    of.state = coordinates_[c].state;
    of.held = coordinates_[c].held;
    of.braking = coordinates_[c].braking;
  }
  equations->contacts() = contacts_;
  equations->bodies().set_states(states_);
}

}  // namespace constraint_sim::engine
