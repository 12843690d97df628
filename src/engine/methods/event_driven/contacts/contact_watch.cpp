// Watched values of ContactEvents in a substep: gaps, margins of forces to their bounds, slips, and
// gaps of coordinates to limits. An event is a change of sign.

#include <algorithm>
#include <cmath>

#include "engine/math/list.h"
#include "engine/math/numbers.h"
#include "engine/methods/event_driven/contacts/contact_events.h"
#include "engine/methods/event_driven/joints/law_events.h"

namespace constraint_sim::engine {
namespace {

using Eigen::Vector3d;

}  // namespace

void ContactEvents::watch_forces(std::size_t c, List<Watched>* list) const {
  const ContactEquations::Contact& contact = equations_.contacts[c];
  const bool has_cone = contact.acts == Acts::kSticks;
  const auto margins = [&](std::size_t stage) {
    const double normal = equations_.normal_force(c, stage);
    const double squared = equations_.force(c, stage).squaredNorm() - normal * normal;
    return std::pair(normal, contact.friction * normal - std::sqrt(std::max(squared, 0.0)));
  };
  Watched watched;
  watched.contact = c;
  watched.tolerance = kForceShare * equations_.largest_force();
  for (const bool is_cone : {false, true}) {
    if (is_cone && !has_cone) continue;
    const auto margin = [&](std::size_t stage) {
      return is_cone ? margins(stage).second : margins(stage).first;
    };
    watched.kind = is_cone ? Watched::Kind::kCone : Watched::Kind::kForce;
    watched.value = margin(0);
    watched.early = 0.0;
    for (std::size_t i = 1; has_stages_ && watched.early == 0.0 && i < DormandPrince8::kStages; ++i)
      if (margin(i) < -watched.tolerance) watched.early = DormandPrince8::kC[i];
    list->push_back(watched);
  }
}

// Watches the force that holds a coordinate against its bounds.
void ContactEvents::watch_held(std::size_t c, List<Watched>* list) const {
  const ContactEquations::Coordinate& of = equations_.coordinates[c];
  const auto limit = [&](bool upper_one) { return equations_.limit(of, upper_one); };
  const auto zeta = [&] { return equations_.zeta(of); };
  const double rate = rate_held_at(of.state.hold, limit, zeta).rate;
  const ForceBounds bounds = force_bounds(of.law, of.state.hold, rate, zeta().rate);
  Watched watched;
  watched.kind = Watched::Kind::kHeld;
  watched.coordinate = c;
  watched.tolerance = kForceShare * equations_.largest_force();
  const auto watch_side = [&](double bound, signed char side) {
    if (!std::isfinite(bound)) return;
    const auto margin = [&](std::size_t stage) {
      return side * (bound - equations_.held_force(c, stage));
    };
    watched.side = side;
    watched.value = margin(0);
    watched.early = 0.0;
    for (std::size_t i = 1; has_stages_ && watched.early == 0.0 && i < DormandPrince8::kStages; ++i)
      if (margin(i) < -watched.tolerance) watched.early = DormandPrince8::kC[i];
    list->push_back(watched);
  };
  watch_side(bounds.least, -1);
  watch_side(bounds.most, 1);
}

void ContactEvents::watch_coordinate(std::size_t c, List<Watched>* list) const {
  const ContactEquations::Coordinate& of = equations_.coordinates[c];
  const ContactEquations::Reading reading = equations_.read(of, &rates_);
  const auto limit = [&](bool upper_one) { return equations_.limit(of, upper_one); };
  const auto zeta = [&] { return equations_.zeta(of); };
  const auto add = [&](Watched::Kind kind, const WatchedValue& value) {
    Watched watched;
    static_cast<WatchedValue&>(watched) = value;
    watched.kind = kind;
    watched.coordinate = c;
    list->push_back(watched);
  };
  watch_limits(of.law, of.state, reading, limit,
               [&](const WatchedValue& value) { add(Watched::Kind::kLimit, value); });
  if (of.state.hold != Hold::kNone) watch_held(c, list);
  const auto add_rate = [&](const WatchedValue& value) { add(Watched::Kind::kRate, value); };
  watch_rates(of.law, of.state, of.braking, reading, limit, zeta, add_rate);
  if (of.law.has_servo()) watch_servo(of.law, of.state, reading, equations_.rest(of), add_rate);
  if (of.state.hold == Hold::kBrake)
    add_rate(watched_end(of.until - equations_.clock(), of.braking));
}

void ContactEvents::watch_breaking(std::size_t j, List<Watched>* list) const {
  const ContactEquations::BodyJoint& of = equations_.joints[j];
  const Joint& joint = of.joint;
  if (of.is_broken || (joint.break_force == 0.0 && joint.break_torque == 0.0)) return;
  // Force and torque; stages are evaluated at the current pose.
  const auto loads = [&](std::size_t stage) {
    const RowVector& force = equations_.joint_force(j, stage);
    if (has_length(joint.kind)) return std::pair(std::abs(force[0]), 0.0);
    const World::JointWrench wrench =
        wrench_of(joint, equations_.state(of.a), equations_.state(of.b), force, 1.0);
    return std::pair(wrench.force.norm(), wrench.torque.norm());
  };
  Watched watched;
  watched.kind = Watched::Kind::kBreak;
  watched.joint = j;
  for (const bool is_torque : {false, true}) {
    const double most = is_torque ? joint.break_torque : joint.break_force;
    if (most == 0.0) continue;
    const auto margin = [&](std::size_t stage) {
      return most - (is_torque ? loads(stage).second : loads(stage).first);
    };
    watched.value = margin(0);
    watched.tolerance = kForceShare * most;
    watched.early = 0.0;
    for (std::size_t i = 1; has_stages_ && watched.early == 0.0 && i < DormandPrince8::kStages; ++i)
      if (margin(i) < -watched.tolerance) watched.early = DormandPrince8::kC[i];
    list->push_back(watched);
  }
}

// Lists all watched values, in an order that depends only on the states of contacts and
// coordinates.
void ContactEvents::watch(List<Watched>* list) {
  list->clear();
  equations_.find_accelerations(derivative(), &rates_);
  for (std::size_t c = 0; c < equations_.contacts.size(); ++c) {
    const ContactEquations::Contact& contact = equations_.contacts[c];
    const ContactPair& pair = pairs_.of(c);
    if (contact.feature.kind == ContactFeature::Kind::kNothing) continue;
    const ContactMotion now = equations_.motion(contact);
    const Vector3d w_dot = ContactEquations::slip_acceleration(now, contact, rates_);
    Watched watched;
    watched.contact = c;
    if (contact.acts == Acts::kOpen) {
      watched.kind = Watched::Kind::kGap;
      watched.known = 2;
      watched.value = now.gap;
      watched.rate = now.gap_rate();
      watched.acceleration = now.n.dot(w_dot) + now.n_dot.dot(now.w);
      watched.tolerance = 4.0 * kEpsilon * equations_.scale();
      list->push_back(watched);
      continue;
    }
    watch_forces(c, list);
    watched.known = 1;
    if (contact.acts == Acts::kSlips && contact.friction > 0.0) {
      watched.kind = Watched::Kind::kSlip;
      watched.value = now.w.dot(contact.direction);
      watched.rate = w_dot.dot(contact.direction);
      watched.tolerance = kEpsilon * equations_.state(contact.a).linear_velocity.norm();
      watched.rough = kEndOfSlip;
      list->push_back(watched);
      watched.rough = 0.0;
    }
    const FeatureMargin margin =
        margin_of(contact.feature, pair.shape_a, equations_.shape_state(pair.a), pair.shape_b,
                  equations_.shape_state(pair.b));
    if (!std::isfinite(margin.value)) continue;
    watched.kind = Watched::Kind::kMargin;
    watched.value = margin.value;
    watched.rate = margin.rate;
    watched.tolerance = 4.0 * kEpsilon * equations_.scale();
    list->push_back(watched);
  }
  for (std::size_t c = 0; c < equations_.coordinates.size(); ++c)
    if (equations_.coordinates[c].is_one_sided) watch_coordinate(c, list);
  for (std::size_t j = 0; j < equations_.joints.size(); ++j) watch_breaking(j, list);
}

}  // namespace constraint_sim::engine
