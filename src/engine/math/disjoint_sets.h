#pragma once

#include <algorithm>
#include <cstddef>
#include <numeric>

#include "engine/math/list.h"

namespace constraint_sim::engine {

/// Disjoint sets of indices, by union-find. The root of a set is its smallest index, in whatever
/// order sets are joined. Storage is kept from one use to the next.
template <class Index>
class DisjointSets {
 public:
  DisjointSets() = default;
  explicit DisjointSets(std::size_t size) { reset(size); }

  /// Makes a set of each index from 0 to size − 1.
  void reset(std::size_t size) {
    resize(size);
    std::iota(parent_.begin(), parent_.end(), Index{0});
  }
  /// Sets the number of indices alone. New indices are in no set before isolate().
  void resize(std::size_t size) { parent_.resize(size); }
  /// Makes a set of one index, to which no other index may belong.
  void isolate(Index i) { parent_[i] = i; }

  /// Root of the set of an index. Halves the path to the root.
  Index find(Index i) {
    while (parent_[i] != i) i = parent_[i] = parent_[parent_[i]];
    return i;
  }
  /// Root of the set of an index. Leaves the path to the root as it is.
  Index root(Index i) const {
    while (parent_[i] != i) i = parent_[i];
    return i;
  }
  bool is_root(Index i) const { return parent_[i] == i; }

  /// Joins the sets of two indices. Returns false where both are in one set already.
  bool join(Index i, Index j) {
    const Index a = find(i);
    const Index b = find(j);
    parent_[std::max(a, b)] = std::min(a, b);
    return a != b;
  }
  /// Links each index to its root directly.
  void flatten() {
    // A parent is smaller than its child, and is linked to its root before the child is.
    for (std::size_t i = 0; i < parent_.size(); ++i) parent_[i] = parent_[parent_[i]];
  }

 private:
  List<Index> parent_;  // a root is its own parent
};

}  // namespace constraint_sim::engine
