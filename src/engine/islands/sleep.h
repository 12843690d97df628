#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <utility>

#include "engine/islands/island_lists.h"
#include "engine/islands/topology.h"
#include "engine/islands/watched_pair.h"
#include "engine/math/list.h"
#include "engine/model/model.h"
#include "engine/model/state.h"

namespace constraint_sim::engine {

/// Indices of everything that the stages of a step go through, ascending.
struct AwakeSets {
  List<int> islands;
  List<int> bodies;     ///< dynamic bodies, and kinematic bodies that move
  List<int> joints;     ///< joints that act on dynamic bodies that are awake
  List<int> kinematic;  ///< kinematic bodies that move
};

/// Indices of bodies and acting joints that the stages leave out, ascending.
struct RestingSets {
  List<int> bodies, joints;
};

/// Wakes all bodies of an island as soon as one of them, or a body near one of them, is awake.
/// `islands`: bodies of each island.
void spread_waking(const Model& model, const List<const List<int>*>& islands,
                   const List<std::pair<int, int>>& near, List<bool>* sleeps);

/// Whether a kinematic body moves.
bool is_moving_by_itself(const Model& model, const State& state, std::size_t body);

/// Whether something drives an island, which may then begin to move from rest: a joint that closes,
/// a motor, a force of a plugin, a wrench, or a joint to a moving kinematic body.
bool is_driven(const Model& model, const State& state, const Topology& topology,
               const IslandMembers& members, std::size_t island);

/// Islands at rest are left out of every stage until something touches them.
///
/// An island rests when nothing in it has moved for `sleep_after`: to the bit where the island is
/// integrated, so that the next step would only repeat the last step; by no more than `sleep_speed`
/// where impulses hold the island, whose rounding never ends. A sleeping island keeps its state,
/// with velocities of zero, and the impulses that held it: how long it slept makes no difference.
class Sleep {
 public:
  const AwakeSets& awake() const { return awake_; }
  /// Whether a body woke up since the awake sets were listed.
  bool has_new_waking() const { return any_waking_; }
  /// Whether the awake sets changed since the methods were chosen.
  bool awake_sets_changed() const { return awake_sets_changed_; }
  /// Whether the stages of a step have work: something is awake, or the awake sets changed.
  bool needs_stages() const { return awake_sets_changed_ || !awake_.bodies.empty(); }
  void forget_change() { awake_sets_changed_ = false; }
  /// The methods are chosen again, as after a change of the awake sets.
  void choose_again() { awake_sets_changed_ = true; }

  void wake(std::size_t body, State* state) {
    if (!state->asleep[body]) return;
    any_waking_ = true;
    state->asleep[body] = false;
  }
  void wake(const std::pair<int, int>& bodies, State* state) {
    wake(to_index(bodies.first), state);
    wake(to_index(bodies.second), state);
  }
  void wake_all(State* state);
  /// Wakes bodies that sleep in contact with a body.
  void wake_around(const Model& model, BodyId id, State* state);
  /// Takes over from a scene or a snapshot which bodies are asleep.
  void continue_from(bool any_waking) {
    may_sleep_ = true;
    any_waking_ = any_waking;
  }

  /// Wakes everything that joints or contacts connect with bodies that are awake, and lists the
  /// awake sets anew. Moves contacts of bodies that woke up from `resting` to `touching`.
  RestingSets spread(const Model& model, const Topology& topology, IslandLists* lists,
                     State* state);
  /// Lets islands fall asleep at the end of a step. `near`: pairs that might have touched in this
  /// step. Returns the awake and resting sets, or nullopt where no island fell asleep.
  std::optional<RestingSets> fall_asleep(const Model& model, const Topology& topology,
                                         const List<WatchedPair>& near, IslandLists* lists,
                                         State* state);

  /// Visits everything that the next step continues from, as engine/support/memory.h describes.
  template <class Self, class Visit>
  static void visit_memory(Self& self, Visit& visit) {
    visit(self.any_waking_);
    visit(self.awake_sets_changed_);
  }

 private:
  bool is_quiet(const Model& model, const State& state, const Island& island,
                const IslandMembers& members) const;
  bool find_candidates(const Model& model, const Topology& topology, const State& state,
                       const List<WatchedPair>& near, const IslandLists& lists);
  RestingSets list_awake(const Model& model, const Topology& topology, const State& state,
                         IslandLists* lists);

  bool may_sleep_ = true;  // false: no body is asleep
  bool any_waking_ = false, awake_sets_changed_ = true;
  AwakeSets awake_;
  std::uint64_t quiet_steps_ = 0;  // after which an island may rest; 0: never
  List<bool> is_candidate_;        // islands about to fall asleep
  List<int> candidates_;           // indices of these
};

}  // namespace constraint_sim::engine
