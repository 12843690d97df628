#pragma once

#include <utility>

#include "engine/math/list.h"

namespace constraint_sim::engine {

/// What belongs together, as indices, each list ascending.
struct IslandMembers {
  List<int> bodies;
  List<int> joints;

  bool operator==(const IslandMembers& other) const {
    return bodies == other.bodies && joints == other.joints;
  }
};

/// The islands that joints make of the bodies of [0, movable.size()), in the order of their first
/// bodies. Immovable bodies are in none, and connect nothing. Union-find: Tarjan, J. ACM 22 (1975)
/// 215.
List<IslandMembers> find_islands(const List<bool>& movable, const List<bool>& acting,
                                 const List<std::pair<std::size_t, std::size_t>>& joint_ends);

}  // namespace constraint_sim::engine
