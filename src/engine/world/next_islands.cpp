#include "engine/world/next_islands.h"

#include <algorithm>
#include <utility>

#include "engine/islands/method_choice.h"
#include "engine/math/list.h"
#include "engine/world/world_impl.h"

namespace constraint_sim::engine {
namespace {

// Returns the island of these members: unchanged where the members are unchanged, else a new
// island.
NextIsland next_island(const WorldImpl& world, IslandMembers members) {
  const std::size_t first = to_index(members.bodies.front());
  const int old =
      !world.edits.all() && world.topology.knows(first) ? world.topology.island_of(first) : -1;
  if (old >= 0 && world.island_parts[old].members == members) {
    const IslandParts& parts = world.island_parts[old];
    return {std::move(members), world.islands[old], parts, parts.is_fresh};
  }
  const Island island = new_island(world, members);
  return {std::move(members), island, world.loaded_memory_of(island.first_body), true};
}

void choose_next_methods(const WorldImpl& world, const List<JointEnds>& ends,
                         const List<int>& next_of, List<NextIsland>* next) {
  List<std::pair<int, int>> near;  // bodies in contact before the edits
  for (const List<TouchingPair>* pairs : {&world.touching, &world.resting})
    for (const TouchingPair& pair : *pairs)
      if (world.is_known(pair)) near.emplace_back(world.find(pair.id_a), world.find(pair.id_b));
  List<bool> sleeps = world.asleep;
  if (world.sleep.has_new_waking()) {
    List<const List<int>*> members;
    for (const NextIsland& island : *next) members.push_back(&island.members.bodies);
    spread_waking(world, members, near, &sleeps);
  }
  List<bool> in_contact(next->size(), false);
  for (const auto& [a, b] : near) {
    if (sleeps[a] || sleeps[b]) continue;
    for (const int body : {a, b})
      if (next_of[body] >= 0) in_contact[next_of[body]] = true;
  }
  const auto was_in_group = [&](int body) {
    return std::find(world.groups.bodies().begin(), world.groups.bodies().end(),
                     world.body_ids[body]) != world.groups.bodies().end();
  };
  const FastestSprings fastest(world, world.joint_states, ends);
  for (std::size_t i = 0; i < next->size(); ++i) {
    auto& [members, island, memory, is_fresh] = (*next)[i];
    island.local_error = 0.0;
    island.substeps = island.rejected = island.evaluations = island.iterations =
        island.unresolved_bodies = 0;
    if (sleeps[members.bodies.front()]) {
      island.why = MethodReason::kAtRest;
      memory.quiet_for = 0;
      continue;
    }
    island.dependent_rows = 0;
    const MethodReason nature = classify(traits_of(world, members, fastest), world.options);
    MethodChoice choice = choose(nature, in_contact[i], memory, world.step_count, world.options);
    if (follows_contacts(world.options) &&
        suits_group(world, world.step_count, members, nature, memory) &&
        std::any_of(members.bodies.begin(), members.bodies.end(), was_in_group))
      choice = {Method::kEventDriven, MethodReason::kFewContacts};
    island.method = choice.method;
    island.why = choice.why;
  }
}

// Lets islands begin anew that cannot go on with other forces of their joints.
void follow_other_laws(const WorldImpl& world, const List<JointEnds>& ends,
                       const List<int>& next_of, List<NextIsland>* next) {
  if (world.edits.bodies_with_other_laws().empty()) return;
  const FastestSprings fastest(world, world.joint_states, ends);
  for (const BodyId id : world.edits.bodies_with_other_laws()) {
    const int body = world.find(id);
    if (body < 0 || (*next)[next_of[body]].is_fresh) continue;
    NextIsland& island = (*next)[next_of[body]];
    const MethodReason nature = classify(traits_of(world, island.members, fastest), world.options);
    if (!world.goes_on(to_index(world.topology.island_of(to_index(body))), nature))
      island.begin_anew();
  }
}

}  // namespace

List<NextIsland> next_islands(const WorldImpl& world) {
  List<NextIsland> next;
  List<JointEnds> ends;
  for (const Joint& joint : world.joints) ends.push_back(ends_of(world, joint));
  if (world.edits.any_topology())
    for (IslandMembers& members : group_bodies(world, world.joint_states, ends))
      next.push_back(next_island(world, std::move(members)));
  else
    for (std::size_t i = 0; i < world.islands.size(); ++i)
      next.push_back({world.island_parts[i].members, world.islands[i], world.island_parts[i],
                      world.island_parts[i].is_fresh});
  List<int> next_of(world.bodies.size(), -1);
  for (std::size_t i = 0; i < next.size(); ++i)
    for (const int body : next[i].members.bodies) next_of[body] = static_cast<int>(i);

  if (world.edits.all() && !world.edits.any_topology())
    for (NextIsland& island : next) island.memory = island.memory.after_edit();
  for (const BodyId id : world.edits.bodies()) {
    const int body = world.find(id);
    if (body < 0) continue;
    next[next_of[body]].begin_anew();
  }
  follow_other_laws(world, ends, next_of, &next);
  choose_next_methods(world, ends, next_of, &next);
  return next;
}

const WorldImpl& compiled(const WorldImpl& world, std::optional<WorldImpl>* copy) {
  if (!world.edits.any()) return world;
  copy->emplace(world).rebuild_topology();
  return **copy;
}

List<std::pair<BodyId, IslandMemory>> memories_of(const WorldImpl& world) {
  List<std::pair<BodyId, IslandMemory>> memories;
  for (std::size_t i = 0; i < world.island_parts.size(); ++i)
    if (!world.island_parts[i].is_none())
      memories.emplace_back(world.islands[i].first_body, world.island_parts[i]);
  return memories;
}

List<std::pair<BodyId, IslandMemory>> next_memories(const WorldImpl& world) {
  if (!world.edits.any()) return memories_of(world);
  List<std::pair<BodyId, IslandMemory>> memories;
  for (const NextIsland& next : next_islands(world))
    if (!next.memory.is_none()) memories.emplace_back(next.island.first_body, next.memory);
  return memories;
}

bool restarts_methods(const WorldImpl& world, std::size_t i) {
  const IslandParts& parts = world.island_parts[i];
  if (!parts.is_fresh || world.options.method == Method::kSequentialImpulses) return false;
  if (!parts.members.joints.empty()) return true;
  const std::size_t body = static_cast<std::size_t>(parts.members.bodies.front());
  return world.masses[body].can_turn() && !world.masses[body].is_isotropic();
}

}  // namespace constraint_sim::engine
