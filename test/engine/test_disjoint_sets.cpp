// Disjoint sets of indices, against labels that spread from neighbour to neighbour.

#include <algorithm>
#include <utility>

#include "engine/math/disjoint_sets.h"
#include "support.h"

namespace constraint_sim::engine {
namespace {

using ConnectedPairs = List<std::pair<int, int>>;

/// Smallest index that pairs connect with each index.
List<int> smallest_connected(int size, const ConnectedPairs& pairs) {
  List<int> smallest;
  for (int i = 0; i < size; ++i) smallest.push_back(i);
  for (bool any_changed = true; any_changed;) {
    any_changed = false;
    for (const auto& [i, j] : pairs) {
      const int least = std::min(smallest[i], smallest[j]);
      any_changed = any_changed || smallest[i] != least || smallest[j] != least;
      smallest[i] = smallest[j] = least;
    }
  }
  return smallest;
}

TEST(DisjointSets, HaveTheSmallestIndexAsRootInEachOrder) {
  constexpr int kSize = 60;
  Random random;
  const auto any = [&] { return std::min(kSize - 1, static_cast<int>(30.0 * (1.0 + random()))); };
  DisjointSets<int> sets;
  for (int trial = 0; trial < 100; ++trial) {
    sets.reset(kSize);
    ConnectedPairs pairs;
    for (int k = 0; k < 45; ++k) {
      const List<int> before = smallest_connected(kSize, pairs);
      const auto& [i, j] = pairs.emplace_back(any(), any());
      EXPECT_EQ(sets.join(i, j), before[i] != before[j]);
    }
    const List<int> expected = smallest_connected(kSize, pairs);
    const DisjointSets<int> unflattened = sets;
    sets.flatten();
    for (int i = 0; i < kSize; ++i) {
      EXPECT_EQ(unflattened.root(i), expected[i]);
      EXPECT_EQ(DisjointSets<int>(unflattened).find(i), expected[i]);
      EXPECT_EQ(sets.root(i), expected[i]);
      EXPECT_EQ(sets.is_root(i), expected[i] == i);
    }
  }
}

TEST(DisjointSets, BeginAnewWithoutTheSetsBefore) {
  DisjointSets<std::size_t> sets(4);
  sets.join(3, 1);
  sets.reset(6);
  for (std::size_t i = 0; i < 6; ++i) EXPECT_TRUE(sets.is_root(i));
  sets.join(2, 5);
  sets.isolate(5);
  EXPECT_EQ(sets.find(5), 5u);
}

}  // namespace
}  // namespace constraint_sim::engine
