#include "engine/islands/sleep.h"

#include <algorithm>
#include <cmath>

#include "engine/constraints/custom_code.h"
#include "engine/constraints/joint.h"
#include "engine/constraints/joint_kinds.h"

namespace constraint_sim::engine {
namespace {

constexpr std::uint64_t kReturns = 4;  // times as long awake where contacts are left to impulses

/// Moves what is not kept from one sorted list to another.
template <class Kept>
void move_over(List<TouchingPair>* from, List<TouchingPair>* to, Kept kept) {
  const auto moved = std::stable_partition(from->begin(), from->end(), kept);
  if (moved == from->end()) return;
  to->insert(to->end(), moved, from->end());
  from->erase(moved, from->end());
  std::sort(to->begin(), to->end(), TouchingPair::in_order);
}

}  // namespace

// ---- waking

void Sleep::wake_all(State* state) {
  if (!may_sleep_) return;
  for (std::size_t i = 0; i < state->asleep.size(); ++i) wake(i, state);
  may_sleep_ = false;
}

void Sleep::wake_around(const Model& model, BodyId id, State* state) {
  for (const TouchingPair& pair : state->resting) {
    if (!model.is_known(pair.id_a) || !model.is_known(pair.id_b)) continue;
    if (pair.id_a == id) wake(model.index(pair.id_b), state);
    if (pair.id_b == id) wake(model.index(pair.id_a), state);
  }
}

RestingSets Sleep::spread(const Model& model, const Topology& topology, IslandLists* lists,
                          State* state) {
  if (any_waking_) {
    List<const List<int>*> islands;
    for (const IslandParts& parts : lists->island_parts) islands.push_back(&parts.members.bodies);
    List<std::pair<int, int>> near;
    for (const TouchingPair& pair : state->resting) near.push_back(pair.ends());
    spread_waking(model, islands, near, &state->asleep);
  }
  any_waking_ = false;
  move_over(&state->resting, &state->touching, [&](const TouchingPair& pair) {
    return state->asleep[pair.a] || state->asleep[pair.b];
  });
  return list_awake(model, topology, *state, lists);
}

void spread_waking(const Model& model, const List<const List<int>*>& islands,
                   const List<std::pair<int, int>>& near, List<bool>* sleeps) {
  const auto wake_other = [&](int body, int other) {
    if (!model.is_movable(to_index(body)) || (*sleeps)[body] || !(*sleeps)[other]) return false;
    (*sleeps)[other] = false;
    return true;
  };
  for (bool spreads = true; spreads;) {
    spreads = false;
    for (const List<int>* island : islands) {
      for (const int body : *island) spreads = wake_other(island->front(), body) || spreads;
      for (const int body : *island) spreads = wake_other(body, island->front()) || spreads;
    }
    for (const auto& [a, b] : near) {
      spreads = wake_other(a, b) || spreads;
      spreads = wake_other(b, a) || spreads;
    }
  }
}

// ---- falling asleep

std::optional<RestingSets> Sleep::fall_asleep(const Model& model, const Topology& topology,
                                              const List<WatchedPair>& near, IslandLists* lists,
                                              State* state) {
  if (quiet_steps_ == 0) return std::nullopt;
  bool any_due = false;  // islands that others keep awake come back at each multiple
  for (const int i : awake_.islands) {
    IslandParts& parts = lists->island_parts[i];
    parts.quiet_for =
        is_quiet(model, *state, lists->islands[i], parts.members) ? parts.quiet_for + 1 : 0;
    any_due = any_due || (parts.quiet_for > 0 && parts.quiet_for % quiet_steps_ == 0);
  }
  if (!any_due || !find_candidates(model, topology, *state, near, *lists)) return std::nullopt;

  may_sleep_ = true;
  for (const int i : candidates_) {
    // Memory that counts steps would depend on how long the island sleeps.
    static_cast<IslandMemory&>(lists->island_parts[i]) = {};
    for (const int body : lists->island_parts[i].members.bodies) {
      state->asleep[body] = true;
      state->states[body].linear_velocity.setZero();
      state->states[body].angular_velocity.setZero();
      state->corrections[body].setZero();
    }
  }
  const auto is_awake = [&](int body) {
    return model.is_movable(to_index(body)) && !state->asleep[body];
  };
  move_over(&state->touching, &state->resting, [&](const TouchingPair& pair) {
    return is_awake(pair.a) || is_awake(pair.b) ||
           !(state->asleep[pair.a] || state->asleep[pair.b]);
  });
  return list_awake(model, topology, *state, lists);
}

bool Sleep::is_quiet(const Model& model, const State& state, const Island& island,
                     const IslandMembers& members) const {
  // The first body decides in most islands, since most bodies are fast.
  const std::size_t first = to_index(members.bodies.front());
  if (state.states[first].linear_velocity.squaredNorm() >
      model.options.sleep_speed * model.options.sleep_speed)
    return false;
  const bool by_impulses = uses_impulses(island.method) || island.why == MethodReason::kFewContacts;
  const double limit = by_impulses ? model.options.sleep_speed * model.options.sleep_speed : 0.0;
  for (const int body : members.bodies) {
    const BodyState& body_state = state.states[body];
    if (body_state.linear_velocity.squaredNorm() > limit) return false;
    const double radius = model.masses[body].radius_of_gyration();
    if (radius * radius * body_state.angular_velocity.squaredNorm() > limit) return false;
    if (!by_impulses || !state.any_corrections) continue;
    // a load that corrections lift by its sinking in each step does not rest
    const Twist& correction = state.corrections[body];
    if (correction.head<3>().squaredNorm() > limit) return false;
    if (radius * radius * correction.tail<3>().squaredNorm() > limit) return false;
  }
  return true;
}

bool is_driven(const Model& model, const State& state, const Topology& topology,
               const IslandMembers& members, std::size_t island) {
  const double now = state.time(model.options.time_step);
  for (const int index : members.joints) {
    const std::size_t j = to_index(index);
    if (state.joint_states[j].closing || is_custom_force(model.joints[j].kind)) return true;
    bool is_moving = false;
    for (const CoordinateState& coordinate : state.joint_states[j].coordinates)
      is_moving = is_moving || coordinate.braking > 0.0;  // on its way back
    visit_motors(model.joints[j], state.joint_states[j],
                 [&](const Motor& motor, double end) { is_moving |= drives(motor, now < end); });
    if (is_moving || any_coordinate(model.joints[j], [](const CoordinateLaw& law) {
          return law.motor && law.motor->force.value_or(0.0) != 0.0;
        }))
      return true;
    for (const std::size_t end : {topology.ends(j).first, topology.ends(j).second})
      if (!model.is_movable(end) && is_moving_by_itself(model, state, end)) return true;
  }
  return std::any_of(state.wrenches.begin(), state.wrenches.end(), [&](const Wrench& wrench) {
    return topology.island_of(model.index(wrench.body)) == static_cast<int>(island);
  });
}

bool is_moving_by_itself(const Model& model, const State& state, std::size_t body) {
  return model.bodies[body].type == BodyType::kKinematic &&
         !(state.states[body].linear_velocity.isZero(0.0) &&
           state.states[body].angular_velocity.isZero(0.0));
}

// Finds undriven islands that were quiet for long enough and that no moving body touches, or may
// touch within a step.
bool Sleep::find_candidates(const Model& model, const Topology& topology, const State& state,
                            const List<WatchedPair>& near, const IslandLists& lists) {
  is_candidate_.assign(lists.islands.size(), false);
  for (const int i : awake_.islands) {
    const IslandParts& parts = lists.island_parts[i];
    // Impulses leave overlaps, so islands come back from impulses before they rest. Islands that
    // fall back each time are kept awake for a bounded time.
    const bool waits = state.step_count <= parts.contacts_refused_until;
    const std::uint64_t least = (waits ? kReturns : 1) * quiet_steps_;
    is_candidate_[i] =
        parts.quiet_for >= least && !is_driven(model, state, topology, parts.members, to_index(i));
  }
  const auto keep_awake = [&](int body, int other) {
    if (!model.is_movable(to_index(body)) || !is_candidate_[topology.island_of(body)]) return false;
    const bool other_moves = model.is_movable(to_index(other))
                                 ? !is_candidate_[topology.island_of(other)]
                                 : is_moving_by_itself(model, state, to_index(other));
    if (other_moves) is_candidate_[topology.island_of(body)] = false;
    return other_moves;
  };
  for (bool spreads = true; spreads;) {
    spreads = false;
    for (const TouchingPair& pair : state.touching) {
      spreads = keep_awake(pair.a, pair.b) || spreads;
      spreads = keep_awake(pair.b, pair.a) || spreads;
    }
    for (const auto& [pair, apart] : near) {  // they would wake at once
      spreads = keep_awake(pair.first, pair.second) || spreads;
      spreads = keep_awake(pair.second, pair.first) || spreads;
    }
  }
  candidates_.clear();
  for (const int i : awake_.islands)
    if (is_candidate_[i]) candidates_.push_back(i);
  return !candidates_.empty();
}

// Lists the sets that the stages go through, after a body woke up or fell asleep.
RestingSets Sleep::list_awake(const Model& model, const Topology& topology, const State& state,
                              IslandLists* lists) {
  awake_sets_changed_ = true;
  const double quiet = std::ceil(model.options.sleep_after / model.options.time_step);
  quiet_steps_ = quiet < 1e18 ? static_cast<std::uint64_t>(quiet) : 0;
  awake_.islands.clear();
  for (std::size_t i = 0; i < lists->islands.size(); ++i) {
    if (!state.asleep[lists->island_parts[i].members.bodies.front()]) {
      awake_.islands.push_back(static_cast<int>(i));
      continue;
    }
    Island& island = lists->islands[i];
    island.why = MethodReason::kAtRest;
    island.local_error = 0.0;
    island.substeps = island.rejected = island.evaluations = island.iterations =
        island.unresolved_bodies = 0;
    lists->island_parts[i].quiet_for = 0;
  }
  awake_.bodies.clear();
  awake_.kinematic.clear();
  RestingSets resting_sets;
  for (std::size_t i = 1; i < model.bodies.size(); ++i) {
    const bool moves_by_itself = is_moving_by_itself(model, state, i);
    if (moves_by_itself) awake_.kinematic.push_back(static_cast<int>(i));
    const bool is_awake = moves_by_itself || (model.is_movable(i) && !state.asleep[i]);
    (is_awake ? awake_.bodies : resting_sets.bodies).push_back(static_cast<int>(i));
  }
  awake_.joints.clear();
  for (std::size_t j = 0; j < model.joints.size(); ++j) {
    if (!acts(model.joints[j], state.joint_states[j])) continue;
    const auto [a, b] = topology.ends(j);
    (state.asleep[model.is_movable(a) ? a : b] ? resting_sets.joints : awake_.joints)
        .push_back(static_cast<int>(j));
  }
  return resting_sets;
}

}  // namespace constraint_sim::engine
