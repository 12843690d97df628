#pragma once

#include "engine/collision/broadphase.h"
#include "engine/islands/contact_groups.h"
#include "engine/islands/island_lists.h"
#include "engine/islands/rollback.h"
#include "engine/islands/step.h"
#include "engine/math/list.h"
#include "engine/model/state.h"

namespace constraint_sim::engine {

/// Overlaps that a step makes beside its contacts: by a pair whose gap was beyond the contact
/// margin, or by a corner that turned into the other shape. Estimates from velocities cannot see
/// them.
class UnseenOverlaps {
 public:
  struct Overlap {
    Broadphase::Pair pair;
    double depth;  ///< [m]
  };

  void begin_step() { pairs_.clear(); }
  /// Takes over a pair before it moves, unless groups of contacts locate the hits of both bodies.
  void note(const StepContext& step, const State& state, const IslandLists& lists,
            const ContactGroups& groups, const Broadphase::Pair& pair);
  /// Whether no pair was taken over.
  bool is_empty() const { return pairs_.empty(); }
  /// Finds how much deeper pairs overlap after the motion; `before`: the state before it.
  const List<Overlap>& find(const StepContext& step, const Rollback& before, const State& state);

 private:
  List<Overlap> pairs_;  // with their depth before the step
  List<Overlap> found_;
};

}  // namespace constraint_sim::engine
