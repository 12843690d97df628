#include "engine/islands/island_lists.h"

namespace constraint_sim::engine {

Island new_island(const Model& model, const IslandMembers& members) {
  Island island;
  island.first_body = model.body_ids[to_index(members.bodies.front())];
  island.bodies = static_cast<std::uint32_t>(members.bodies.size());
  island.joints = static_cast<std::uint32_t>(members.joints.size());
  return island;
}

IslandMemory IslandLists::loaded_memory_of(BodyId first) const {
  IslandMemory found;
  for (const auto& [first_body, memory] : loaded_memory)
    if (first_body == first) found = memory;
  return found;
}

void IslandLists::keep_island(std::size_t old, IslandLists* before) {
  islands.push_back(before->islands[old]);
  IslandParts& parts = island_parts.emplace_back(std::move(before->island_parts[old]));
  if (parts.motion < 0) return;
  const std::size_t m = to_index(parts.motion);
  parts.motion = static_cast<int>(motions.size());
  motions.push_back(std::move(before->motions[m]));
}

bool IslandLists::goes_on(std::size_t i, MethodReason nature) const {
  const IslandParts& parts = island_parts[i];
  return parts.nature == nature && islands[i].why == nature && !uses_impulses(islands[i].method) &&
         parts.motion >= 0 && !motions[to_index(parts.motion)].has_lent();
}

void IslandLists::restart_all() {
  for (IslandParts& parts : island_parts) parts.is_fresh = true;
  list_fresh();
}

void IslandLists::list_fresh() {
  fresh_islands.clear();
  for (std::size_t i = 0; i < island_parts.size(); ++i)
    if (island_parts[i].is_fresh) fresh_islands.push_back(static_cast<int>(i));
}

}  // namespace constraint_sim::engine
