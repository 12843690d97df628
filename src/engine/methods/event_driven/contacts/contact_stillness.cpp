// Intervals of ContactEvents without motion. An interval whose start has the bits of an earlier one
// has the same result, to the bit, and is not computed again.

#include <algorithm>

#include "engine/math/list.h"
#include "engine/math/same_bits.h"
#include "engine/methods/event_driven/contacts/contact_events.h"

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

bool are_same(const ContactEquations::Body& l, const ContactEquations::Body& r) {
  return l.index == r.index && l.mass.inverse_mass == r.mass.inverse_mass &&
         l.mass.inertia == r.mass.inertia && l.mass.inverse_inertia == r.mass.inverse_inertia &&
         have_same_bits(l.force, r.force) && have_same_bits(l.torque, r.torque) &&
         are_same(l.shape_pose, r.shape_pose);
}

bool are_same(const Shape& l, const Shape& r) {
  if (l.index() != r.index()) return false;
  if (const auto* box = std::get_if<Box>(&l)) return box->size == std::get<Box>(r).size;
  if (const auto* sphere = std::get_if<Sphere>(&l))
    return sphere->radius == std::get<Sphere>(r).radius;
  return std::holds_alternative<Plane>(l);
}

bool are_same(const ContactEvents::Pair& l, const ContactEvents::Pair& r) {
  return l.a == r.a && l.b == r.b && l.friction == r.friction && l.restitution == r.restitution &&
         l.held == r.held && l.stuck == r.stuck && l.is_still == r.is_still &&
         are_same(l.shape_a, r.shape_a) && are_same(l.shape_b, r.shape_b);
}

template <class Container>
bool are_all_same(const Container& l, const Container& r) {
  return std::equal(l.begin(), l.end(), r.begin(), r.end(),
                    [](const auto& a, const auto& b) { return are_same(a, b); });
}

}  // namespace

// Whether the interval starts like the last one without motion. False with joints, whose forces
// depend on more than bodies and pairs.
bool ContactEvents::is_as_when_still(const Interval& span) const {
  if (!still_.is_known || done_.spans || !equations_.joints.empty() || equations_.has_movers() ||
      span.h != still_.h || !have_same_bits(span.gravity, still_.gravity) ||
      !are_all_same(equations_.bodies, still_.bodies) || !are_all_same(pairs_, still_.pairs))
    return false;
  const List<double>& numbers = equations_.numbers();
  if (!have_same_bits(numbers.data(), still_.numbers.data(), numbers.size())) return false;
  for (std::size_t i = equations_.movable; i < still_.states.size(); ++i)
    if (!are_same(equations_.state(i), still_.states[i])) return false;
  return true;
}

void ContactEvents::note_beginning(const Interval& span) {
  still_.is_known = false;
  still_.gravity = span.gravity;
  still_.h = span.h;
  still_.numbers = equations_.numbers();
  still_.bodies = equations_.bodies;
  still_.pairs = pairs_;
}

// Stores the first interval of a step, where nothing has moved in it.
void ContactEvents::note_stillness() {
  still_.is_known = told_.empty() && done_.events == 0;
  still_.states = equations_.states();
  still_.contacts = equations_.contacts;
}

void ContactEvents::go_on_as_when_still(List<BodyState>* states) {
  for (Pair& pair : pairs_)
    pair.held = pair.stuck = pair.is_still = false;  // reset as after reporting
  equations_.contacts = still_.contacts;
  equations_.set_states(still_.states);
  equations_.scatter_state(states);
}

}  // namespace constraint_sim::engine
