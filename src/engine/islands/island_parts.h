#pragma once

#include <cstdint>

#include "constraint_sim/engine/island.h"
#include "engine/islands/island_memory.h"
#include "engine/islands/islands.h"
#include "engine/math/list.h"

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

/// Part of a step that events advanced, before impulses took over.
struct FoundPart {
  double time = 0.0;   ///< from the start of the step [s]; 0: none
  double error = 0.0;  ///< estimated error of the part [m]
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
  FoundPart found;

  bool is_fresh = true;         ///< no step since an edit of the island
  bool is_stale = false;        ///< bodies or laws differ from the compiled ones
  bool has_other_laws = false;  ///< laws of joints have changed since the last compilation
  List<int> open_points;        ///< joints without axes that were open when the island was compiled
  WatchedEnergy energy;
  bool has_limited_spring = false;  ///< has a spring with a force limit: its energy is not ½ k C²
};

}  // namespace constraint_sim::engine
