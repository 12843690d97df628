#include "engine/islands/contact_pipeline.h"

#include <algorithm>
#include <iterator>
#include <utility>

#include "engine/islands/divided_step.h"
#include "engine/islands/motion_bounds.h"
#include "engine/model/impulse_method.h"

namespace constraint_sim::engine {

using Eigen::Vector3d;

void ContactPipeline::set_shapes(const Model& model, const State& state,
                                 const List<int>& awake_bodies, const List<int>& resting_bodies) {
  const auto has_shape = [&](int body) { return may_touch(model.bodies[body]); };
  moving_shapes_.clear();
  std::copy_if(awake_bodies.begin(), awake_bodies.end(), std::back_inserter(moving_shapes_),
               has_shape);
  proxies_.clear();
  for (const int body : resting_bodies)
    if (has_shape(body)) add_proxies(model, state.states[body], body, 0.0, &proxies_);
  const auto movable = [&](int body) { return model.is_movable(to_index(body)); };
  const bool any_movable =
      std::any_of(moving_shapes_.begin(), moving_shapes_.end(), movable) ||
      std::any_of(proxies_.begin(), proxies_.end(), [](const Proxy& p) { return p.movable; });
  if (!any_movable || moving_shapes_.size() + proxies_.size() < 2) moving_shapes_.clear();
  if (moving_shapes_.empty()) proxies_.clear();
  broadphase_.set_resting(proxies_);
}

void ContactPipeline::find_pairs(const StepContext& step, const State& state,
                                 const List<int>& fast_bodies, const ContactReach* reach,
                                 StepReport* report) {
  const Model& model = step.model;
  proxies_.clear();
  auto fast = fast_bodies.begin();
  for (const int body : moving_shapes_) {
    const BodyState& now = state.states[body];
    double margin = reach != nullptr ? reach->travel_bound(body) : 0.0;
    if (fast != fast_bodies.end() && *fast == body) {
      margin += max_distance(step, now, body, model.options.time_step);
      ++fast;
    }
    if (controls_contacts(model.options))
      margin += max_distance(step, now, body, model.options.time_step);
    else if (solves_impulses(model.options))
      margin += displacement_with_fall(model.options, now, model.options.time_step);
    add_proxies(model, now, body, margin, &proxies_);
  }
  report->costs.candidate_pairs =
      static_cast<std::uint32_t>(broadphase_.find_pairs(proxies_).size());
  if (broadphase_.is_full()) throw StepFailed{Failure::kTooManyPairs};
}

void ContactPipeline::collide(const StepContext& step, State* state, StepReport* report) {
  const Model& model = step.model;
  std::swap(state->touching, touching_before_);
  is_collided_ = true;
  state->touching.clear();
  if (pairs().empty()) return;
  const StageTimer timer(step.clock, Stage::kNarrowphase, &report->costs.stage_times);
  std::size_t points = 0;
  auto before = touching_before_.begin();  // both lists are sorted, so one pass matches them
  for (const Broadphase::Pair& ends : pairs()) {
    if (step.topology.is_unpaired(ends.bodies())) continue;
    if (is_set(step.stop)) return;
    const double margin = solves_impulses(model.options)
                              ? contact_margin(step, *state, ends, model.options.time_step)
                              : 0.0;
    const Manifold manifold = engine::collide(model, *state, ends, margin);
    if (manifold.count == 0) continue;
    points += to_index(manifold.count);
    if (points > kMostContacts) throw StepFailed{Failure::kTooManyContacts};

    TouchingPair& pair = state->touching.emplace_back(new_contact(model, ends));
    pair.manifold = manifold;
    while (before != touching_before_.end() && before->shapes() < ends) ++before;
    const bool known =
        model.options.warm_starting && before != touching_before_.end() && before->shapes() == ends;
    for (std::size_t k = 0; k < to_index(manifold.count); ++k)
      pair.impulses[k] =
          known ? before->impulse_of(manifold.points[k].feature) : Vector3d(Vector3d::Zero());
  }
}

void ContactPipeline::restore_contacts(List<TouchingPair>* touching) {
  if (!is_collided_) return;
  std::swap(*touching, touching_before_);
  touching_before_.clear();  // contacts of the abandoned attempt may hold numbers out of range
  is_collided_ = false;
}

}  // namespace constraint_sim::engine
