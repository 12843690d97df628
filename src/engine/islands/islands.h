#pragma once

#include <utility>

#include "engine/math/list.h"

namespace constraint_sim::engine {

/// Bodies and joints of an island, by index, ascending.
struct IslandMembers {
  List<int> bodies;
  List<int> joints;

  bool operator==(const IslandMembers& other) const {
    return bodies == other.bodies && joints == other.joints;
  }
};

/// Returns the islands that acting joints make of the bodies, in the order of their first bodies.
/// Immovable bodies are in no island and connect none. Union-find: Tarjan, J. ACM 22 (1975) 215.
List<IslandMembers> find_islands(const List<bool>& movable, const List<bool>& acting,
                                 const List<std::pair<std::size_t, std::size_t>>& joint_ends);

}  // namespace constraint_sim::engine
