#include "engine/methods/event_driven/joints/event_problem.h"

#include <algorithm>
#include <cmath>

#include "engine/dynamics/held_response.h"
#include "engine/methods/event_driven/law_events.h"

namespace constraint_sim::engine {
namespace {

// Adds the impulses on the two bodies of a joint by a unit impulse along J, each body once.
void add_unit(std::pair<std::size_t, std::size_t> ends, const Jacobian& J, BodyImpulse* unit) {
  const auto add = [&](std::size_t body, const Eigen::Vector3d& linear,
                       const Eigen::Vector3d& angular) {
    if (body == 0) return;
    std::size_t i = 0;
    while (unit->body[i] != 0 && unit->body[i] != static_cast<int>(body)) ++i;
    if (unit->body[i] == 0) unit->linear[i] = unit->angular[i] = Eigen::Vector3d::Zero();
    unit->body[i] = static_cast<int>(body);
    unit->linear[i] += linear;
    unit->angular[i] += angular;
  };
  add(ends.first, J.j1, J.j2);
  add(ends.second, J.j3, J.j4);
}

}  // namespace

bool EventProblem::load(const EventMotions& motions, const Interval& interval,
                        const EventBodies& bodies, double t, EquationsOfMotion* bare,
                        List<BodyState>* states, IntegrationResult* progress) {
  y_.resize(bare->size());
  dydt_.resize(bare->size());
  bare->forget_redundant_rows();
  bare->begin_step(motions.joint_states());
  gather_state(*bare, *states, y_.data());
  bare->begin(t, *states, interval.gravity, interval.loads, motions.bare_prescribed(),
              interval.since_tick + (t - interval.t));
  const double before = kinetic_energy(*bare, y_.data());
  if (!bare->start(t, y_.data(), dydt_.data())) return false;
  progress->projected += before - kinetic_energy(*bare, y_.data());
  bare->scatter_state(y_.data(), states);
  Motions rates;
  find_accelerations(*bare, y_.data(), dydt_.data(), &rates);
  reading_.clear();
  for (const OneSidedLaw& law : motions.laws())
    reading_.push_back(read_law(motions, bodies, law, t, *bare, rates));
  find_acting(motions, t);
  find_responses(motions, bare);
  return true;
}

// Finds the laws that may have a force or an impulse: all but limits that are away.
void EventProblem::find_acting(const EventMotions& motions, double t) {
  const List<OneSidedLaw>& laws = motions.laws();
  acting_.clear();
  column_.assign(laws.size(), -1);
  for (std::size_t c = 0; c < laws.size(); ++c) {
    const auto is_reached = [&](bool upper_one) {
      if (!std::isfinite(laws[c].limit(upper_one))) return false;
      const double beyond = reading_[c].q - motions.limit(c, upper_one, t).value;
      return (upper_one ? -beyond : beyond) <= kTouching;
    };
    if (!laws[c].may_hold_anywhere() && !laws[c].has_servo() &&
        !std::isfinite(laws[c].limit_force) && !is_reached(false) && !is_reached(true))
      continue;
    column_[c] = eigen_index(acting_.size());
    acting_.push_back(c);
  }
}

void EventProblem::find_responses(const EventMotions& motions, EquationsOfMotion* bare) {
  const EventJoints& joints = motions.joints();
  const List<OneSidedLaw>& laws = motions.laws();
  const std::size_t n = acting_.size();
  response_.resize(n);
  joint_impulses_.resize(n);
  is_free_.assign(laws.size(), 0);
  A_.setZero(eigen_index(n), eigen_index(n));
  const List<int>& bodies = bare->bodies();
  List<BodyImpulse> units;
  for (const std::size_t c : acting_) {
    const std::size_t l = laws[c].joint;
    BodyImpulse& unit = units.emplace_back();
    if (!laws[c].is_coupling) {
      add_unit(joints.ends(l), reading_[c].J, &unit);
      continue;
    }
    add_unit(joints.ends(joints.terms(l)[0].joint), reading_[c].J, &unit);
    add_unit(joints.ends(joints.terms(l)[1].joint), reading_[c].J_second, &unit);
  }
  const auto rate_of = [&](const BodyImpulse& along, const Motions& motions) {
    double rate = 0.0;
    for (std::size_t k = 0; k < along.body.size() && along.body[k] != 0; ++k) {
      const auto found = std::find(bodies.begin(), bodies.end(), along.body[k]);
      if (found == bodies.end()) continue;
      const auto i = static_cast<std::size_t>(found - bodies.begin());
      rate += along.linear[k].dot(motions.linear[i]) + along.angular[k].dot(motions.angular[i]);
    }
    return rate;
  };
  for (std::size_t k = 0; k < n; ++k) {
    if (motions.is_broken(laws[acting_[k]].joint)) continue;
    response_[k] = held_response(*bare, bare->inputs(), bare->kinematics(), units[k],
                                 &bare->delassus(), &joint_impulses_[k]);
    for (std::size_t i = 0; i < n; ++i)
      A_(eigen_index(i), eigen_index(k)) = rate_of(units[i], response_[k]);
    const bool is_free = A_(eigen_index(k), eigen_index(k)) >
                         kHeld * free_response(*bare, bare->kinematics(), units[k]);
    is_free_[acting_[k]] = is_free ? 1 : 0;
  }
  A_ = (0.5 * (A_ + A_.transpose())).eval();
}

void EventProblem::add_impulse(std::size_t c, double impulse, EquationsOfMotion* bare) {
  const auto k = static_cast<std::size_t>(column(c));
  bare->add_response(response_[k], joint_impulses_[k], impulse, y_.data());
  for (const std::size_t d : acting_) reading_[d].rate += A(d, c) * impulse;
  hit_[c] += impulse;
}

}  // namespace constraint_sim::engine
