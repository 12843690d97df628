#pragma once

#include <cstddef>
#include <utility>
#include <vector>

#include "constraint_sim/engine/id.h"
#include "constraint_sim/engine/island.h"
#include "engine/islands/island_memory.h"
#include "engine/islands/island_motion.h"
#include "engine/islands/island_parts.h"
#include "engine/islands/islands.h"
#include "engine/math/list.h"
#include "engine/model/model.h"

namespace constraint_sim::engine {

/// The islands of a world, in the order of their first bodies.
struct IslandLists {
  List<IslandParts> island_parts;
  std::vector<Island> islands;  ///< reports of the islands, in the same order
  List<IslandMotion> motions;   ///< compiled islands: islands with joints that are integrated
  List<int> fresh_islands;      ///< islands without a step since an edit of them
  /// Memories that a scene or a snapshot brought, by first body, until there are islands.
  List<std::pair<BodyId, IslandMemory>> loaded_memory;

  /// Makes islands of these members. `old_island(body)` is the index of the island that a body had,
  /// or -1: islands of the same members keep what is compiled for them.
  template <class OldIsland>
  void regroup(const Model& model, List<IslandMembers> groups, OldIsland old_island);
  IslandMemory loaded_memory_of(BodyId first) const;
  /// Whether the method of an island goes on when forces of its joints change, and its nature is
  /// `nature` then: it is advanced by the method of its nature, and no other has borrowed its
  /// equations.
  bool goes_on(std::size_t island, MethodReason nature) const;
  /// Makes all islands fresh.
  void restart_all();
  /// Lists the islands that are marked as fresh.
  void list_fresh();

 private:
  void keep_island(std::size_t old, IslandLists* before);
};

/// The report of an island before its first step.
Island new_island(const Model& model, const IslandMembers& members);

template <class OldIsland>
void IslandLists::regroup(const Model& model, List<IslandMembers> groups, OldIsland old_island) {
  IslandLists before;
  std::swap(before, *this);
  std::swap(before.loaded_memory, loaded_memory);
  islands.reserve(groups.size());
  island_parts.reserve(groups.size());
  for (IslandMembers& members : groups) {
    const int old = old_island(to_index(members.bodies.front()));
    if (old >= 0 && before.island_parts[old].members == members) {
      keep_island(to_index(old), &before);
      continue;
    }
    islands.push_back(new_island(model, members));
    IslandParts& parts = island_parts.emplace_back();
    parts.members = std::move(members);
    static_cast<IslandMemory&>(parts) = loaded_memory_of(islands.back().first_body);
  }
  loaded_memory.clear();
}

}  // namespace constraint_sim::engine
