#pragma once

#include <optional>
#include <utility>

#include "engine/islands/island_memory.h"
#include "engine/islands/islands.h"
#include "engine/math/list.h"
#include "engine/world/world_impl.h"

// Predicts the islands of the next step while edits are not compiled. Queries, saving and hashes
// need them, and must not change the world. The prediction calls the functions by which a step
// compiles edits, so both agree.

namespace constraint_sim::engine {

struct NextIsland {
  IslandMembers members;
  Island island;
  IslandMemory memory;  ///< memory with which the next step begins
  bool is_fresh;        ///< the island was edited since the last step

  void begin_anew() {
    if (!is_fresh) memory = memory.after_edit();
    is_fresh = true;
  }
};

List<NextIsland> next_islands(const WorldImpl& world);
/// Returns this world if its edits are compiled, else `copy`, a copy with compiled edits.
const WorldImpl& compiled(const WorldImpl& world, std::optional<WorldImpl>* copy);
/// Returns the memories of islands that are not empty, by first body, in the order of islands.
List<std::pair<BodyId, IslandMemory>> memories_of(const WorldImpl& world);
/// Returns the memories with which the next step begins, after pending edits are compiled.
List<std::pair<BodyId, IslandMemory>> next_memories(const WorldImpl& world);
/// Whether the method of an island begins anew in the next step although it has memory that could
/// continue. Otherwise the next step of a fresh island depends only on saved state.
bool restarts_methods(const WorldImpl& world, std::size_t island);

}  // namespace constraint_sim::engine
