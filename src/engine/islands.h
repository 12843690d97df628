#pragma once

#include <utility>
#include <vector>

namespace constraint_sim::engine {

/// What belongs together, as indices, each list ascending.
struct IslandMembers {
  std::vector<int> bodies;
  std::vector<int> joints;

  bool operator==(const IslandMembers& other) const {
    return bodies == other.bodies && joints == other.joints;
  }
};

/// The islands that joints make of the bodies of [0, movable.size()), in the order of their first
/// bodies. Immovable bodies are in none, and connect nothing. Union-find: Tarjan, J. ACM 22 (1975)
/// 215.
std::vector<IslandMembers> find_islands(
    const std::vector<bool>& movable, const std::vector<bool>& acting,
    const std::vector<std::pair<std::size_t, std::size_t>>& joint_ends);

}  // namespace constraint_sim::engine
