#include "engine/islands/rollback.h"

namespace constraint_sim::engine {

void Rollback::resize(const State& state, std::size_t islands) {
  states_.resize(state.states.size());
  joint_states_.resize(state.joint_states.size());
  memory_.resize(islands);
}

void Rollback::save(const AwakeSets& awake, const State& state, const List<IslandParts>& islands) {
  for (const int i : awake.bodies) states_[i] = state.states[i];
  for (const int j : awake.joints) joint_states_[j] = state.joint_states[j];
  for (const int i : awake.islands) memory_[i] = islands[i];
  is_saved_ = true;
  had_corrections_ = state.any_corrections;
  if (had_corrections_) corrections_ = state.corrections;
}

void Rollback::save_methods(const AwakeSets& awake, const IslandLists& lists) {
  methods_.resize(lists.islands.size());
  for (const int i : awake.islands) {
    const Island& island = lists.islands[to_index(i)];
    methods_[i] = {island.method, island.why};
  }
}

void Rollback::restore_methods(const AwakeSets& awake, IslandLists* lists) const {
  for (const int i : awake.islands) {
    Island& island = lists->islands[to_index(i)];
    island.method = methods_[i].method;
    island.why = methods_[i].why;
  }
}

void Rollback::restore(const AwakeSets& awake, State* state, List<IslandParts>* islands) const {
  for (const int i : awake.bodies) state->states[i] = states_[i];
  for (const int j : awake.joints) state->joint_states[j] = joint_states_[j];
  for (const int i : awake.islands) static_cast<IslandMemory&>((*islands)[i]) = memory_[i];
  if (had_corrections_)
    state->corrections = corrections_;
  else if (state->any_corrections)
    for (Twist& correction : state->corrections) correction.setZero();
  state->any_corrections = had_corrections_;
}

void Rollback::restore(const IslandMembers& members, State* state) const {
  for (const int body : members.bodies) state->states[body] = states_[body];
  for (const int j : members.joints) state->joint_states[j] = joint_states_[j];
  if (!had_corrections_) return;
  for (const int body : members.bodies) state->corrections[body] = corrections_[body];
  state->remove_correction_velocities(members.bodies);
}

}  // namespace constraint_sim::engine
