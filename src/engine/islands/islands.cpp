#include "engine/islands/islands.h"

#include "engine/math/disjoint_sets.h"
#include "engine/math/list.h"

namespace constraint_sim::engine {

List<IslandMembers> find_islands(const List<bool>& movable, const List<bool>& acting,
                                 const List<std::pair<std::size_t, std::size_t>>& joint_ends) {
  DisjointSets<std::size_t> sets(movable.size());
  for (std::size_t j = 0; j < joint_ends.size(); ++j) {
    const auto& [a, b] = joint_ends[j];
    if (acting[j] && movable[a] && movable[b]) sets.join(a, b);
  }

  List<IslandMembers> islands;
  List<std::size_t> island_of(movable.size());
  for (std::size_t i = 0; i < movable.size(); ++i) {
    if (!movable[i]) continue;
    const std::size_t root = sets.find(i);
    if (root == i) {
      island_of[i] = islands.size();
      islands.emplace_back();
    }
    islands[island_of[root]].bodies.push_back(static_cast<int>(i));
  }
  for (std::size_t j = 0; j < joint_ends.size(); ++j) {
    if (!acting[j]) continue;
    const auto& [a, b] = joint_ends[j];
    islands[island_of[sets.find(movable[a] ? a : b)]].joints.push_back(static_cast<int>(j));
  }
  return islands;
}

}  // namespace constraint_sim::engine
