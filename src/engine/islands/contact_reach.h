#pragma once

#include <cstddef>
#include <optional>
#include <utility>

#include "engine/collision/broadphase.h"
#include "engine/islands/island_lists.h"
#include "engine/islands/sleep.h"
#include "engine/islands/step.h"
#include "engine/islands/topology.h"
#include "engine/islands/watched_pair.h"
#include "engine/math/disjoint_sets.h"
#include "engine/math/list.h"
#include "engine/model/model.h"
#include "engine/model/state.h"

namespace constraint_sim::engine {

/// Limits of an event-driven group.
struct GroupLimits {
  std::size_t bodies, points;
  double work;  ///< in a step, in substeps of a group with one point
};

GroupLimits group_limits(const WorldOptions& options);

/// Whether hits of a body with bodies like it cost no energy.
bool keeps_energy(const Body& body);
/// Whether a body is a sphere that keeps all energy, whose rotation nothing changes.
bool is_elastic_sphere(const Model& model, std::size_t body);

/// Size of a possible event-driven group: islands that watched pairs connect.
struct GroupSize {
  std::size_t bodies = 0, points = 0;
  double travel_bound = 0.0;  ///< largest travel bound of its bodies [m]
  bool has_pairs = false, overlaps = false, is_elastic = true;
  bool is_settled = true;   ///< overlaps are no deeper than impulses leave them at rest
  bool was_handed = false;  ///< impulses have taken over an island of the group, and still have it
};

/// Which bodies may meet within a step, where contacts are event-driven. A body that is hit gets up
/// to twice as fast as the body that hits it, so a body may get to twice its own displacement; near
/// other bodies, to the displacement of the fastest of these. Possible groups grow from pair to
/// pair until no other body is near enough.
class ContactReach {
 public:
  /// Bound of the distance that a body travels in this step [m].
  double travel_bound(int body) const { return travel_bounds_[body]; }
  /// Pairs that may touch within the step.
  const List<WatchedPair>& watched_pairs() const { return watched_pairs_; }
  /// The first island that watched pairs connect with an island; only where there are such pairs.
  int leader_of(std::size_t island) const { return groups_.root(static_cast<int>(island)); }
  const GroupSize& size_of_group(int leader) const { return sizes_[leader]; }

  void forget_pairs() { watched_pairs_.clear(); }
  /// Begins with the travel bound of each body by itself.
  void begin(const StepContext& step, const State& state, const List<int>& moving_shapes);
  /// Watches the pairs that may touch, out of all whose bounds overlap. True where a body of a
  /// group got a larger travel bound.
  bool grow(const StepContext& step, const State& state, const IslandLists& lists,
            const AwakeSets& awake, const List<Broadphase::Pair>& pairs);

 private:
  void watch_pairs(const StepContext& step, const State& state, std::size_t islands,
                   const List<Broadphase::Pair>& pairs);
  void list_group_sizes(const StepContext& step, const State& state, const IslandLists& lists,
                        const AwakeSets& awake);
  std::optional<Separation> separation_to_watch(const Model& model, const Topology& topology,
                                                const State& state,
                                                const Broadphase::Pair& pair) const;

  List<WatchedPair> watched_pairs_;
  DisjointSets<int> groups_;        // islands of possible groups
  List<GroupSize> sizes_;           // by leader
  List<double> travel_bounds_;      // by body, whatever hits the body [m]
  List<double> own_travel_bounds_;  // by body, while nothing hits the body [m]
};

}  // namespace constraint_sim::engine
