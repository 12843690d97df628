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

bool are_same(const ContactPair& l, const ContactPair& r) {
  return l.shape_index_a == r.shape_index_a && l.shape_index_b == r.shape_index_b &&
         l.friction == r.friction && l.restitution == r.restitution && l.held == r.held &&
         l.stuck == r.stuck && l.is_still == r.is_still && are_same(l.shape_a, r.shape_a) &&
         are_same(l.shape_b, r.shape_b);
}

template <class Container>
bool are_all_same(const Container& l, const Container& r) {
  return std::equal(l.begin(), l.end(), r.begin(), r.end(),
                    [](const auto& a, const auto& b) { return are_same(a, b); });
}

}  // namespace

bool UnchangedInterval::is_repeated_by(const Interval& span, const ContactEquations& equations,
                                       const List<ContactPair>& pairs) const {
  const GroupBodies& bodies = equations.bodies();
  if (!is_known_ || !equations.joints().list().empty() || bodies.has_movers() || span.h != h_ ||
      !have_same_bits(span.gravity, gravity_) || !are_all_same(bodies.list(), bodies_) ||
      !are_all_same(bodies.shapes().list(), shapes_) || !are_all_same(pairs, pairs_))
    return false;
  const List<double>& numbers = bodies.numbers();
  if (!have_same_bits(numbers.data(), numbers_.data(), numbers.size())) return false;
  for (std::size_t i = bodies.movable(); i < states_.size(); ++i)
    if (!are_same(bodies.state(i), states_[i])) return false;
  return true;
}

void UnchangedInterval::begin(const Interval& span, const ContactEquations& equations,
                              const List<ContactPair>& pairs) {
  const GroupBodies& bodies = equations.bodies();
  is_known_ = false;
  gravity_ = span.gravity;
  h_ = span.h;
  numbers_ = bodies.numbers();
  bodies_ = bodies.list();
  shapes_ = bodies.shapes().list();
  pairs_ = pairs;
}

void UnchangedInterval::end(const ContactEquations& equations) {
  is_known_ = true;
  states_ = equations.bodies().states();
  contacts_ = equations.contacts();
}

void UnchangedInterval::repeat(ContactEquations* equations) const {
  equations->contacts() = contacts_;
  equations->bodies().set_states(states_);
}

}  // namespace constraint_sim::engine
