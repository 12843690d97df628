#pragma once

#include <utility>

namespace constraint_sim::engine {

/// Largest displacement of two shapes relative to each other, as a share of the smaller thickness,
/// in a step that is not fast and in a substep between events. The shapes cannot pass through each
/// other within it, and a deep overlap still shows the side from which they came.
inline constexpr double kFastShare = 0.25;

/// Two convex shapes of different bodies: the bodies by index, and of each the number of its part.
/// A body of one shape has part 0.
struct ShapePair {
  int first = 0, second = 0;  ///< bodies, first < second
  int part_first = 0, part_second = 0;

  std::pair<int, int> bodies() const { return {first, second}; }
  friend bool operator==(const ShapePair& l, const ShapePair& r) {
    return l.first == r.first && l.second == r.second && l.part_first == r.part_first &&
           l.part_second == r.part_second;
  }
  friend bool operator!=(const ShapePair& l, const ShapePair& r) { return !(l == r); }
  /// Orders pairs by their bodies, then by their parts.
  friend bool operator<(const ShapePair& l, const ShapePair& r) {
    if (l.first != r.first) return l.first < r.first;
    if (l.second != r.second) return l.second < r.second;
    if (l.part_first != r.part_first) return l.part_first < r.part_first;
    return l.part_second < r.part_second;
  }
};

}  // namespace constraint_sim::engine
