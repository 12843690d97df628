// Finds the islands with which the next step will begin, while edits are not compiled yet. Queries
// use this file: it changes nothing, and calls the functions that compile.cpp and a step call.

#include <algorithm>

#include "engine/math/list.h"
#include "engine/world/world_impl.h"

namespace constraint_sim::engine {
List<World::Impl::NextIsland> World::Impl::next_islands() const {
  List<NextIsland> next;
  List<JointEnds> ends;
  for (const Joint& joint : joints) ends.push_back(ends_of(*this, joint));
  if (edits.any_topology())
    for (IslandMembers& members : group_bodies(*this, joint_states, ends))
      next.push_back(next_island(std::move(members)));
  else
    for (std::size_t i = 0; i < islands.size(); ++i)
      next.push_back(
          {island_parts[i].members, islands[i], island_parts[i], island_parts[i].is_fresh});
  List<int> next_of(bodies.size(), -1);
  for (std::size_t i = 0; i < next.size(); ++i)
    for (const int body : next[i].members.bodies) next_of[body] = static_cast<int>(i);

  if (edits.all() && !edits.any_topology())
    for (NextIsland& island : next) island.memory = island.memory.after_edit();
  for (const BodyId id : edits.bodies()) {
    const int body = find(id);
    if (body < 0) continue;
    NextIsland& island = next[next_of[body]];
    if (!island.is_fresh) island.memory = island.memory.after_edit();
    island.is_fresh = true;
  }
  choose_next_methods(ends, next_of, &next);
  return next;
}

// Returns the island of these members: unchanged where the members are unchanged, else a new
// island.
World::Impl::NextIsland World::Impl::next_island(IslandMembers members) const {
  const std::size_t first = to_index(members.bodies.front());
  const int old = !edits.all() && topology.knows(first) ? topology.island_of(first) : -1;
  if (old >= 0 && island_parts[old].members == members) {
    const IslandParts& parts = island_parts[old];
    return {std::move(members), islands[old], parts, parts.is_fresh};
  }
  const Island island = new_island(*this, members);
  return {std::move(members), island, loaded_memory_of(island.first_body), true};
}

void World::Impl::choose_next_methods(const List<JointEnds>& ends, const List<int>& next_of,
                                      List<NextIsland>* next) const {
  List<std::pair<int, int>> near;  // bodies in contact before the edits
  for (const List<TouchingPair>* pairs : {&touching, &resting})
    for (const TouchingPair& pair : *pairs)
      if (is_known(pair)) near.emplace_back(find(pair.id_a), find(pair.id_b));
  List<bool> sleeps = asleep;
  if (sleep.is_stale()) {
    List<const List<int>*> members;
    for (const NextIsland& island : *next) members.push_back(&island.members.bodies);
    engine::spread_waking(*this, members, near, &sleeps);
  }
  List<bool> in_contact(next->size(), false);
  for (const auto& [a, b] : near) {
    if (sleeps[a] || sleeps[b]) continue;
    for (const int body : {a, b})
      if (next_of[body] >= 0) in_contact[next_of[body]] = true;
  }
  const auto was_in_group = [&](int body) {
    return std::find(groups.bodies().begin(), groups.bodies().end(), body_ids[body]) !=
           groups.bodies().end();
  };
  const FastestSprings fastest(*this, joint_states, ends);
  for (std::size_t i = 0; i < next->size(); ++i) {
    auto& [members, island, memory, is_fresh] = (*next)[i];
    island.local_error = 0.0;
    island.substeps = island.rejected = island.iterations = island.unresolved_bodies = 0;
    if (sleeps[members.bodies.front()]) {
      island.why = MethodReason::kAtRest;
      memory.quiet_for = 0;
      continue;
    }
    island.dependent_rows = 0;
    const MethodReason nature = classify(traits_of(*this, members, fastest), options);
    MethodChoice choice = choose(nature, in_contact[i], memory, step_count, options);
    if (follows_contacts(options) && suits_group(*this, step_count, members, nature, memory) &&
        std::any_of(members.bodies.begin(), members.bodies.end(), was_in_group))
      choice = {Method::kEventDriven, MethodReason::kFewContacts};
    island.method = choice.method;
    island.why = choice.why;
  }
}

}  // namespace constraint_sim::engine
