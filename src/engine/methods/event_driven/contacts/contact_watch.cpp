#include "engine/methods/event_driven/contacts/contact_watch.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "engine/constraints/joint_load.h"
#include "engine/math/numbers.h"
#include "engine/methods/event_driven/law_events.h"

namespace constraint_sim::engine {
namespace {

using Eigen::Vector3d;
using Kind = ContactWatched::Kind;

// Adds `watched` with the margin(stage) of a force to its bound.
template <class Margin>
void add_margin(const Margin& margin, const StagedSubstep& last, ContactWatched watched,
                List<ContactWatched>* list) {
  watched.value = margin(0);
  watched.early = last.early_below(margin, watched.value, watched.tolerance);
  list->push_back(watched);
}

}  // namespace

void watch_contact_forces(const ContactEquations& equations, std::size_t c,
                          const StagedSubstep& last, List<ContactWatched>* list) {
  const ContactEquations::Contact& contact = equations.contacts()[c];
  ContactWatched watched;
  watched.contact = c;
  watched.tolerance = kForceShare * equations.largest_force();
  watched.kind = Kind::kForce;
  add_margin([&](std::size_t stage) { return equations.normal_force(c, stage); }, last, watched,
             list);
  if (contact.acts != ContactEquations::Acts::kSticks) return;
  watched.kind = Kind::kCone;
  const auto margin = [&](std::size_t stage) {
    const double normal = equations.normal_force(c, stage);
    const double squared = equations.force(c, stage).squaredNorm() - normal * normal;
    return contact.friction * normal - std::sqrt(std::max(squared, 0.0));
  };
  add_margin(margin, last, watched, list);
}

void watch_held(const ContactEquations& equations, std::size_t c, const StagedSubstep& last,
                List<ContactWatched>* list) {
  const GroupBodies& bodies = equations.bodies();
  const GroupJoints& joints = equations.joints();
  const GroupCoordinate& of = joints.coordinates()[c];
  const auto limit = [&](bool upper_one) { return joints.limit(bodies, of, upper_one); };
  const auto bounds_before = [&](double back) {
    const auto zeta = [&] { return joints.zeta(bodies, of, back); };
    return force_bounds(of.law, of.state.hold, rate_held_at(of.state.hold, limit, zeta), zeta());
  };
  const ForceBounds bounds = bounds_before(0.0);
  // Bounds jump where the demand of a motor passes the rate of the coordinate, or reverses.
  const auto bounds_at = [&](std::size_t stage) {
    if (stage == 0 || of.law.drive == 0.0) return bounds;
    return bounds_before(last.until_end(stage));
  };
  ContactWatched watched;
  watched.kind = Kind::kHeld;
  watched.coordinate = c;
  watched.tolerance = kForceShare * equations.largest_force();
  const auto watch_side = [&](double ForceBounds::*side_of, signed char side) {
    if (!std::isfinite(bounds.*side_of)) return;
    watched.side = side;
    const auto margin = [&](std::size_t stage) {
      return side * (bounds_at(stage).*side_of - equations.held_force(c, stage));
    };
    add_margin(margin, last, watched, list);
  };
  watch_side(&ForceBounds::least, -1);
  watch_side(&ForceBounds::most, 1);
}

void watch_breaking(const ContactEquations& equations, std::size_t j, const StagedSubstep& last,
                    List<ContactWatched>* list) {
  const GroupBodies& bodies = equations.bodies();
  const GroupJoint& of = equations.joints()[j];
  const Joint& joint = of.joint;
  if (!of.may_break()) return;
  // Force and torque; stages are evaluated at the current pose.
  const auto loads = [&](std::size_t stage) {
    const GroupForces& forces = equations.joint_force(j, stage);
    return load_of(joint, bodies.state(of.a), bodies.state(of.b), forces.rows, forces.coupling);
  };
  ContactWatched watched;
  watched.kind = Kind::kBreak;
  watched.joint = j;
  for (const bool is_torque : {false, true}) {
    const double most = is_torque ? joint.break_torque : joint.break_force;
    if (most == 0.0) continue;
    watched.tolerance = kForceShare * most;
    const auto margin = [&](std::size_t stage) {
      return most - (is_torque ? loads(stage).torque : loads(stage).force);
    };
    add_margin(margin, last, watched, list);
  }
}

void ContactWatch::add_coordinate(const ContactEquations& equations, std::size_t c,
                                  const StagedSubstep& last, List<ContactWatched>* list) const {
  const GroupBodies& bodies = equations.bodies();
  const GroupJoints& joints = equations.joints();
  const GroupCoordinate& of = joints.coordinates()[c];
  const GroupJoints::Reading reading = joints.read(bodies, of, &rates_);
  const auto limit = [&](bool upper_one) { return joints.limit(bodies, of, upper_one); };
  const auto zeta = [&] { return joints.zeta(bodies, of); };
  const auto add = [&](Kind kind, const WatchedValue& value) {
    ContactWatched watched;
    static_cast<WatchedValue&>(watched) = value;
    watched.kind = kind;
    watched.coordinate = c;
    list->push_back(watched);
  };
  watch_limits(of.law, of.state, reading, limit,
               [&](const WatchedValue& value) { add(Kind::kLimit, value); });
  if (of.state.hold != Hold::kNone) watch_held(equations, c, last, list);
  const auto add_rate = [&](const WatchedValue& value) { add(Kind::kRate, value); };
  watch_rates(of.law, of.state, of.braking, reading, limit, zeta, add_rate);
  if (of.law.has_servo()) watch_servo(of.law, of.state, reading, joints.rest(bodies, of), add_rate);
  if (of.state.hold == Hold::kBrake) add_rate(watched_end(of.until - bodies.clock(), of.braking));
}

void ContactWatch::add_contact(const ContactEquations& equations, const ContactPairs& pairs,
                               std::size_t c, const StagedSubstep& last,
                               List<ContactWatched>* list) const {
  const GroupBodies& bodies = equations.bodies();
  const ContactEquations::Contact& contact = equations.contacts()[c];
  if (contact.feature.kind == ContactFeature::Kind::kNothing) return;
  const ContactMotion now = equations.motion(contact);
  const Vector3d w_dot = ContactEquations::slip_acceleration(now, contact, rates_);
  ContactWatched watched;
  watched.contact = c;
  watched.touching = pairs.tolerances().touching;
  watched.resting = pairs.tolerances().resting;
  if (contact.acts == ContactEquations::Acts::kOpen) {
    watched.kind = Kind::kGap;
    watched.known = 2;
    watched.value = now.gap;
    watched.rate = now.gap_rate();
    watched.acceleration = now.n.dot(w_dot) + now.n_dot.dot(now.w);
    watched.tolerance = 4.0 * kEpsilon * bodies.scale();
    list->push_back(watched);
    return;
  }
  watch_contact_forces(equations, c, last, list);
  watched.known = 1;
  if (contact.acts == ContactEquations::Acts::kSlips && contact.friction > 0.0) {
    watched.kind = Kind::kSlip;
    watched.value = now.w.dot(contact.direction);
    watched.rate = w_dot.dot(contact.direction);
    watched.tolerance = kEpsilon * bodies.state(contact.a).linear_velocity.norm();
    watched.rough = pairs.tolerances().end_of_slip;
    list->push_back(watched);
    watched.rough = 0.0;
  }
  const ContactPair& pair = pairs.of(c);
  const FeatureMargin margin =
      margin_of(contact.feature, pair.shape_a, bodies.shape_state(pair.shape_index_a), pair.shape_b,
                bodies.shape_state(pair.shape_index_b));
  if (!std::isfinite(margin.value)) return;
  watched.kind = Kind::kMargin;
  watched.value = margin.value;
  watched.rate = margin.rate;
  watched.tolerance = 4.0 * kEpsilon * bodies.scale();
  list->push_back(watched);
}

void ContactWatch::list(const ContactEquations& equations, const ContactPairs& pairs,
                        const double* dydt, const StagedSubstep& last, List<ContactWatched>* list) {
  const GroupJoints& joints = equations.joints();
  list->clear();
  equations.bodies().find_accelerations(dydt, &rates_);
  for (std::size_t c = 0; c < equations.contacts().size(); ++c)
    add_contact(equations, pairs, c, last, list);
  for (std::size_t c = 0; c < joints.coordinates().size(); ++c)
    if (joints.coordinates()[c].is_one_sided) add_coordinate(equations, c, last, list);
  for (std::size_t j = 0; j < joints.list().size(); ++j) watch_breaking(equations, j, last, list);
}

}  // namespace constraint_sim::engine
