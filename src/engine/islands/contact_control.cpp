#include "engine/islands/contact_control.h"

#include <algorithm>
#include <iterator>
#include <limits>

#include "engine/islands/motion_bounds.h"
#include "engine/islands/swept_hits.h"
#include "engine/math/larger.h"

namespace constraint_sim::engine {

// Returns the error-control groups, ordered by first body. Moves the contacts of their bodies out
// of `state->touching`.
List<ContactControl::ErrorGroup> ContactControl::find_groups(
    const StepContext& step, const List<int>& bodies, const List<int>& joints,
    const IslandLists& lists, const List<Broadphase::Pair>& near, State* state) const {
  const Model& model = step.model;
  List<bool> is_advanced(model.bodies.size());
  for (const int body : bodies) is_advanced[body] = true;
  List<std::pair<std::size_t, std::size_t>> links;
  for (const int body : bodies) {
    const int first = lists.island_parts[step.topology.island_of(body)].members.bodies.front();
    links.emplace_back(first, body);
  }
  const auto found_of = [&](int body) {
    return lists.island_parts[step.topology.island_of(body)].found.time;
  };
  for (const Broadphase::Pair& pair : near)
    if (is_advanced[pair.first] && is_advanced[pair.second] &&
        found_of(pair.first) == found_of(pair.second))
      links.emplace_back(pair.first, pair.second);
  List<bool> acts(links.size());
  std::fill(acts.begin(), acts.end(), true);
  List<ErrorGroup> groups;
  List<int> group_of(model.bodies.size());
  std::fill(group_of.begin(), group_of.end(), -1);
  for (IslandMembers& members : find_islands(is_advanced, acts, links)) {
    for (const int body : members.bodies) group_of[body] = static_cast<int>(groups.size());
    ErrorGroup& group = groups.emplace_back();
    group.done = found_of(members.bodies.front());
    group.members.bodies = std::move(members.bodies);
  }
  const auto group_of_pair = [&](const std::pair<int, int>& ends) {
    return std::max(group_of[ends.first], group_of[ends.second]);
  };
  for (const int j : joints) {
    const auto [a, b] = step.topology.ends(to_index(j));
    groups[group_of[model.is_movable(a) ? a : b]].members.joints.push_back(j);
  }
  for (const Broadphase::Pair& pair : near) {
    const int of_pair = group_of_pair(pair.bodies());
    const auto takes_part = [&](int body) {
      return group_of[body] == of_pair || !model.is_movable(to_index(body));
    };
    if (of_pair < 0 || step.topology.is_unpaired(pair.bodies())) continue;
    ErrorGroup& group = groups[of_pair];
    if (takes_part(pair.first) && takes_part(pair.second))
      group.near.push_back(pair);
    else if (!group.has_left_any)
      group.has_left_any = is_fast(step, *state, pair, model.options.time_step) &&
                           time_of_hit(step, *state, pair, model.options.time_step);
  }
  List<TouchingPair> others;
  for (TouchingPair& pair : state->touching) {
    const int group = group_of_pair(pair.ends());
    (group < 0 ? others : groups[group].contacts).push_back(pair);
  }
  state->touching = std::move(others);
  return groups;
}

ContactControl::Outcome ContactControl::advance(const StepContext& step, const AwakeSets& awake,
                                                const List<int>& bodies, const List<int>& joints,
                                                const IslandLists& lists,
                                                const List<ActingWrench>& wrenches,
                                                ContactPipeline* pipeline,
                                                SequentialImpulses* method, State* state) {
  Outcome outcome;
  errors_.assign(step.model.bodies.size(), std::numeric_limits<double>::quiet_NaN());
  List<ErrorGroup> groups = find_groups(step, bodies, joints, lists, pipeline->pairs(), state);
  List<TouchingPair> touching = std::move(state->touching);
  bool any_corrections = false;
  const List<BodyState> at_start = state->states;
  const GroupSurroundings around{step, awake, pipeline->moving_shapes(), wrenches, at_start};
  for (ErrorGroup& group : groups) {
    const ControlledStep::Outcome of_group =
        controlled_.advance(around, group.members, group.done, group.near, &group.contacts,
                            pipeline->broadphase(), method, state);
    for (const int body : group.members.bodies) errors_[body] = of_group.error;
    add_impulses(of_group.impulses, &outcome.impulses);
    outcome.error = larger(outcome.error, of_group.error);
    outcome.substeps += of_group.substeps;
    outcome.rejected += of_group.rejected;
    outcome.hits += of_group.hits;
    if (group.has_left_any || of_group.has_left_any)
      outcome.left_body = group.members.bodies.front();
    any_corrections = any_corrections || state->any_corrections;
    std::move(group.contacts.begin(), group.contacts.end(), std::back_inserter(touching));
  }
  for (const TouchingPair& pair : touching)
    outcome.impulses.contacts += static_cast<std::uint32_t>(pair.manifold.count);
  std::sort(touching.begin(), touching.end(), TouchingPair::in_order);
  state->touching = std::move(touching);
  state->any_corrections = any_corrections;
  return outcome;
}

}  // namespace constraint_sim::engine
