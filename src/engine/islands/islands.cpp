#include "engine/islands/islands.h"

#include <numeric>

#include "engine/math/list.h"

namespace constraint_sim::engine {
namespace {

/// Sets of indices, each with its smallest as root.
class Sets {
 public:
  explicit Sets(std::size_t size) : parent_(size) {
    std::iota(parent_.begin(), parent_.end(), std::size_t{0});
  }

  std::size_t root(std::size_t i) {
    while (parent_[i] != i) i = parent_[i] = parent_[parent_[i]];
    return i;
  }

  void join(std::size_t i, std::size_t j) {
    const std::size_t a = root(i);
    const std::size_t b = root(j);
    parent_[std::max(a, b)] = std::min(a, b);
  }

 private:
  List<std::size_t> parent_;
};

}  // namespace

List<IslandMembers> find_islands(const List<bool>& movable, const List<bool>& acting,
                                 const List<std::pair<std::size_t, std::size_t>>& joint_ends) {
  Sets sets(movable.size());
  for (std::size_t j = 0; j < joint_ends.size(); ++j) {
    const auto& [a, b] = joint_ends[j];
    if (acting[j] && movable[a] && movable[b]) sets.join(a, b);
  }

  List<IslandMembers> islands;
  List<std::size_t> island_of(movable.size());
  for (std::size_t i = 0; i < movable.size(); ++i) {
    if (!movable[i]) continue;
    const std::size_t root = sets.root(i);
    if (root == i) {
      island_of[i] = islands.size();
      islands.emplace_back();
    }
    islands[island_of[root]].bodies.push_back(static_cast<int>(i));
  }
  for (std::size_t j = 0; j < joint_ends.size(); ++j) {
    if (!acting[j]) continue;
    const auto& [a, b] = joint_ends[j];
    islands[island_of[sets.root(movable[a] ? a : b)]].joints.push_back(static_cast<int>(j));
  }
  return islands;
}

}  // namespace constraint_sim::engine
