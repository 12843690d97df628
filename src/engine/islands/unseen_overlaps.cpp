#include "engine/islands/unseen_overlaps.h"

#include <algorithm>

#include "engine/islands/divided_step.h"
#include "engine/islands/motion_bounds.h"
#include "engine/model/impulse_method.h"

namespace constraint_sim::engine {
namespace {

// Whether a group of contacts locates the hits of a body.
bool is_followed(const StepContext& step, const IslandLists& lists, const ContactGroups& groups,
                 int body) {
  const int island = step.topology.island_of(to_index(body));
  return island < 0 ||
         (groups.contains(to_index(island)) && !uses_impulses(lists.islands[island].method));
}

bool has_own_motion(const StepContext& step, const State& state, int body) {
  return step.model.is_movable(to_index(body)) && !state.asleep[body];
}

// State of a body before the step. Velocities of kinematic and sleeping bodies do not change.
const BodyState& state_before(const StepContext& step, const Rollback& before, const State& state,
                              int body) {
  return has_own_motion(step, state, body) ? before.states()[body] : state.states[body];
}

// Bound of the displacement of the points of a body in the step [m].
double point_displacement(const StepContext& step, const Rollback& before, const State& state,
                          int body) {
  const double h = step.model.options.time_step;
  const BodyState& end = state.states[body];
  double displacement = h * end.linear_velocity.norm(), turn = h * end.angular_velocity.norm();
  if (has_own_motion(step, state, body)) {
    const BodyState& start = before.states()[body];
    displacement = (end.position - start.position).norm();
    turn = 2.0 * (start.orientation.conjugate() * end.orientation).vec().norm();
  }
  return turn == 0.0
             ? displacement
             : displacement + turn * swing_radius(step.model.bodies[body]);  // planes have no end
}

// Displacement within which the bodies of a pair cannot overlap without a contact [m]. Swept
// bodies sink in by the fall of a step.
double margin_before(const StepContext& step, const Rollback& before, const State& state,
                     const Broadphase::Pair& pair) {
  const WorldOptions& options = step.model.options;
  const double h = options.time_step;
  if (!solves_impulses(options)) return h * h * options.gravity.norm();
  const double most = kMarginShare * thinner_of(step.model, pair);
  return std::min(
      most, displacement_with_fall(options, state_before(step, before, state, pair.first), h) +
                displacement_with_fall(options, state_before(step, before, state, pair.second), h));
}

}  // namespace

void UnseenOverlaps::note(const StepContext& step, const State& state, const IslandLists& lists,
                          const ContactGroups& groups, const Broadphase::Pair& pair) {
  if ((is_followed(step, lists, groups, pair.first) &&
       is_followed(step, lists, groups, pair.second)) ||
      step.topology.is_unpaired(pair.bodies()))
    return;
  double depth = 0.0;
  if (const TouchingPair* contact = find_contact(state.touching, pair))
    for (std::size_t k = 0; k < to_index(contact->manifold.count); ++k)
      depth = std::max(depth, contact->manifold.points[k].depth);
  pairs_.push_back({pair, depth});
}

const List<UnseenOverlaps::Overlap>& UnseenOverlaps::find(const StepContext& step,
                                                          const Rollback& before,
                                                          const State& state) {
  found_.clear();
  for (const auto& [pair, known] : pairs_) {
    if (point_displacement(step, before, state, pair.first) +
            point_displacement(step, before, state, pair.second) <=
        margin_before(step, before, state, pair))
      continue;
    const double depth = -separation_of(step.model, state, pair).gap - known;
    if (depth > 0.0) found_.push_back({pair, depth});
  }
  return found_;
}

}  // namespace constraint_sim::engine
