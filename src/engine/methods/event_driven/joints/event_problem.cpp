#include "engine/methods/event_driven/joints/event_problem.h"

#include <algorithm>

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

bool EventProblem::load(const EventMotions& motions, const Interval& all, const EventBodies& bodies,
                        double t, EquationsOfMotion* bare, List<BodyState>* states,
                        IntegrationResult* progress) {
  y_.resize(bare->size());
  dydt_.resize(bare->size());
  bare->forget_redundant_rows();
  bare->begin_step(motions.joint_states());
  gather_state(*bare, *states, y_.data());
  bare->begin(t, *states, all.gravity, all.loads, motions.bare_courses(),
              all.since_tick + (t - all.t));
  const double before = kinetic_energy(*bare, y_.data());
  if (!bare->start(t, y_.data(), dydt_.data())) return false;
  progress->projected += before - kinetic_energy(*bare, y_.data());
  bare->scatter_state(y_.data(), states);
  Motions rates;
  find_accelerations(*bare, y_.data(), dydt_.data(), &rates);
  reading_.clear();
  for (const OneSidedLaw& law : motions.laws())
    reading_.push_back(read_law(motions, bodies, law, t, *bare, rates));
  find_responses(motions, bare);
  return true;
}

void EventProblem::find_responses(const EventMotions& motions, EquationsOfMotion* bare) {
  const EventJoints& joints = motions.joints();
  const List<OneSidedLaw>& laws = motions.laws();
  const std::size_t n = laws.size();
  response_.resize(n);
  joint_impulses_.resize(n);
  is_free_.assign(n, 0);
  A_.setZero(eigen_index(n), eigen_index(n));
  const List<int>& bodies = bare->bodies();
  List<BodyImpulse> units;
  for (std::size_t c = 0; c < n; ++c) {
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
  for (std::size_t c = 0; c < n; ++c) {
    if (motions.is_broken(laws[c].joint)) continue;
    response_[c] = held_response(*bare, bare->inputs(), bare->kinematics(), units[c],
                                 &bare->delassus(), &joint_impulses_[c]);
    for (std::size_t d = 0; d < n; ++d)
      A_(eigen_index(d), eigen_index(c)) = rate_of(units[d], response_[c]);
    const bool is_free = A_(eigen_index(c), eigen_index(c)) >
                         kHeld * free_response(*bare, bare->kinematics(), units[c]);
    is_free_[c] = is_free ? 1 : 0;
  }
  A_ = (0.5 * (A_ + A_.transpose())).eval();
}

void EventProblem::add_impulse(std::size_t c, double impulse, EquationsOfMotion* bare) {
  bare->add_response(response_[c], joint_impulses_[c], impulse, y_.data());
  for (std::size_t d = 0; d < reading_.size(); ++d)
    reading_[d].rate += A_(eigen_index(d), eigen_index(c)) * impulse;
  hit_[c] += impulse;
}

}  // namespace constraint_sim::engine
