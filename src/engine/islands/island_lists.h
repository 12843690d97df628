#pragma once

#include <cstdint>
#include <utility>
#include <vector>

#include "constraint_sim/engine/id.h"
#include "constraint_sim/engine/island.h"
#include "engine/islands/island_motion.h"
#include "engine/islands/islands.h"
#include "engine/islands/method_choice.h"
#include "engine/math/list.h"
#include "engine/model/model.h"

namespace constraint_sim::engine {

/// Energy of an island, which the monitors compare every Monitors::kWindow steps.
struct WatchedEnergy {
  double before = 0.0;  ///< at the last comparison [J]
  /// Rise without a cause [J]: above its minimum where the island is integrated, since the last
  /// comparison where impulses advance the island.
  double gain = 0.0;
  double most_kinetic = 0.0;     ///< since the last edit [J]
  double corrections = 0.0;      ///< work of corrections and drives since the last comparison [J]
  bool was_driven = false;       ///< whether it was driven (is_driven()) at the last comparison
  bool was_by_impulses = false;  ///< whether impulses advanced it at the last comparison
  bool has_changed = false;  ///< whether it changed to or from impulses since the last comparison
};

/// Members of an island, and its memory from step to step.
struct IslandParts : IslandMemory {
  /// Lets the methods begin anew, after an edit.
  void begin_anew() {
    if (!is_fresh) static_cast<IslandMemory&>(*this) = after_edit();
    is_fresh = true;
  }

  IslandMembers members;
  MethodReason nature = MethodReason::kSmooth;  ///< by joints and options, without contacts
  int motion = -1;           ///< index in IslandLists::motions; -1: no joints, or never integrated
  List<int> turning_freely;  ///< bodies whose rotation no joint acts on

  // Results of a step. Each island writes its own entry, so islands can be advanced in parallel.
  double projected_energy = 0.0, correction_work = 0.0;  ///< [J]
  std::uint32_t changes = 0;                             ///< number of changes of the method
  bool needs_method_choice = false;                      ///< the next step chooses a method anew
  bool has_failed = false;

  bool is_fresh = true;         ///< no step since an edit of the island
  bool is_stale = false;        ///< bodies or laws differ from the compiled ones
  bool has_other_laws = false;  ///< laws of joints have changed since the last compilation
  List<int> open_points;        ///< joints without axes that were open when the island was compiled
  WatchedEnergy energy;
  bool has_limited_spring = false;  ///< has a spring with a force limit: its energy is not ½ k C²
};

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
