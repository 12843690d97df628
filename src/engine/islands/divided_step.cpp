#include "engine/islands/divided_step.h"

#include <algorithm>
#include <utility>

#include "engine/islands/motion_bounds.h"
#include "engine/islands/swept_hits.h"

namespace constraint_sim::engine {

using Eigen::Vector3d;

const TouchingPair* find_contact(const List<TouchingPair>& pairs, const ShapePair& shapes) {
  const auto found = std::lower_bound(
      pairs.begin(), pairs.end(), shapes,
      [](const TouchingPair& pair, const ShapePair& wanted) { return pair.shapes() < wanted; });
  return found != pairs.end() && found->shapes() == shapes ? &*found : nullptr;
}

TouchingPair new_contact(const Model& model, const ShapePair& shapes) {
  TouchingPair pair;
  pair.a = shapes.first;
  pair.b = shapes.second;
  pair.id_a = model.body_ids[pair.a];
  pair.id_b = model.body_ids[pair.b];
  pair.part_a = shapes.part_first;
  pair.part_b = shapes.part_second;
  return pair;
}

void add_contacts(const List<TouchingPair>& of_part, List<TouchingPair>* sums) {
  List<TouchingPair> all;
  for (const TouchingPair& pair : *sums)
    if (find_contact(of_part, pair.shapes()) == nullptr) all.push_back(pair);
  for (const TouchingPair& pair : of_part) {
    all.push_back(pair);
    const TouchingPair* before = find_contact(*sums, pair.shapes());
    if (before == nullptr) continue;
    Vector3d sum = Vector3d::Zero();
    for (std::size_t k = 0; k < to_index(before->manifold.count); ++k) sum += before->impulses[k];
    for (std::size_t k = 0; k < to_index(pair.manifold.count); ++k) {
      const Vector3d same = before->impulse_of(pair.manifold.points[k].feature);
      all.back().impulses[k] += same;
      sum -= same;
    }
    all.back().impulses[0] += sum;  // impulses of points that no longer exist
  }
  std::sort(all.begin(), all.end(), TouchingPair::in_order);
  *sums = std::move(all);
}

void DividedStep::begin(const StepContext& step, const ImpulseGroup& group) {
  is_member_.resize(step.model.bodies.size());
  std::fill(is_member_.begin(), is_member_.end(), false);
  group_ = group;
  for (const int body : group_.bodies) is_member_[body] = true;
  joint_sums_.clear();
}

List<Broadphase::Pair> DividedStep::find_pairs(const StepContext& step, const State& state,
                                               const List<int>& moving_shapes, double duration,
                                               Broadphase* broadphase, bool* is_any_left) {
  const Model& model = step.model;
  proxies_.clear();
  for (const int body : moving_shapes) {
    const BodyState& now = state.states[body];
    const bool moves = is_member_[body] || !model.is_movable(to_index(body));
    add_proxies(model, now, body, moves ? max_distance(step, now, body, duration) : 0.0, &proxies_);
  }
  List<Broadphase::Pair> pairs;
  for (const Broadphase::Pair& pair : broadphase->find_pairs(proxies_)) {
    const bool has_a = is_member_[pair.first];
    const bool has_b = is_member_[pair.second];
    if (!has_a && !has_b) continue;
    if (step.topology.is_unpaired(pair.bodies())) continue;
    const int other = has_a ? pair.second : pair.first;
    if (has_a != has_b && model.is_movable(to_index(other)))
      *is_any_left = *is_any_left || (is_fast(step, state, pair, duration) &&
                                      time_of_hit(step, state, pair, duration));
    else
      pairs.push_back(pair);
  }
  if (broadphase->is_full()) throw StepFailed{Failure::kTooManyPairs};
  return pairs;
}

ImpulseReport DividedStep::advance(const StepContext& step, const List<ActingWrench>& wrenches,
                                   double done, double duration, const ContactStep& contacts,
                                   ImpulseStepKind kind, SequentialImpulses* method, State* state) {
  const Model& model = step.model;
  if (state->any_corrections) state->remove_correction_velocities(group_.bodies);
  const double share = duration / model.options.time_step;
  List<ActingWrench> wrenches_now;
  for (ActingWrench wrench : wrenches) {
    if (!is_member_[wrench.body]) continue;
    wrench.duration *= share;
    wrenches_now.push_back(wrench);
  }
  JointStep interval = joint_step(model.options, step.tick.start + done, duration);
  if (!joint_sums_.empty()) interval.beta *= share;
  const ImpulseStep part{interval,
                         contacts,
                         kind,
                         group_.bodies,
                         group_.joints,
                         step.topology.joint_ends(),
                         step.topology.is_in_loop(),
                         wrenches_now,
                         step.stop,
                         step.clock};
  ImpulseReport report = method->advance(model, part, state);
  report.contacts = 0;  // each is counted once, with the sums
  report.correction_work += method->finish(model, part, state);
  return report;
}

void DividedStep::sum_joints(const Model& model, double duration, State* state) {
  for (std::size_t k = 0; k < joint_sums_.size(); ++k) {
    const std::size_t j = to_index(group_.joints[k]);
    joint_sums_[k].add(model.joints[j], duration, &state->joint_states[j]);
  }
}

void DividedStep::finish_joints(const StepContext& step, State* state) const {
  for (std::size_t k = 0; k < joint_sums_.size(); ++k) {
    const std::size_t j = to_index(group_.joints[k]);
    joint_sums_[k].finish(step.model.joints[j], step.topology.state_a(*state, j),
                          step.topology.state_b(*state, j), step.model.options.time_step,
                          &state->joint_states[j]);
  }
}

}  // namespace constraint_sim::engine
