#pragma once

#include "engine/islands/island_lists.h"
#include "engine/islands/island_parts.h"
#include "engine/islands/method_choice.h"
#include "engine/islands/sleep.h"
#include "engine/math/list.h"
#include "engine/model/state.h"

namespace constraint_sim::engine {

/// States of bodies, joints and islands at the start of a step, to which a step that fails returns.
/// Bodies that a contact woke up stay awake.
class Rollback {
 public:
  /// Makes room for a world with so many bodies, joints and islands.
  void resize(const State& state, std::size_t islands);
  /// Nothing is saved for the step that begins.
  void begin_step() { is_saved_ = false; }
  bool is_saved() const { return is_saved_; }
  /// Saves the state of everything awake.
  void save(const AwakeSets& awake, const State& state, const List<IslandParts>& islands);
  /// Saves the methods of awake islands, for a repeat of the step.
  void save_methods(const AwakeSets& awake, const IslandLists& lists);
  /// Restores everything that save() saved; the awake sets are those of save().
  void restore(const AwakeSets& awake, State* state, List<IslandParts>* islands) const;
  /// Restores everything that save_methods() saved.
  void restore_methods(const AwakeSets& awake, IslandLists* lists) const;
  /// Restores the bodies and joints of an island, without the corrections of the step before.
  void restore(const IslandMembers& members, State* state) const;

  /// By index, of bodies and joints that are awake.
  const List<BodyState>& states() const { return states_; }
  const List<JointData>& joint_states() const { return joint_states_; }

 private:
  bool is_saved_ = false, had_corrections_ = false;
  List<BodyState> states_;
  List<Twist> corrections_;
  List<JointData> joint_states_;
  List<IslandMemory> memory_;
  List<MethodChoice> methods_;
};

}  // namespace constraint_sim::engine
