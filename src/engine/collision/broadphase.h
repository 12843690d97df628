#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <utility>

#include "constraint_sim/engine/body.h"
#include "constraint_sim/engine/report.h"
#include "engine/math/list.h"

namespace constraint_sim::engine {

/// Axis-aligned bounding box in world coordinates [m]. Of a plane it is infinite.
struct Aabb {
  Eigen::Vector3d min;
  Eigen::Vector3d max;
};

/// Whether two boxes share a point, touching included; stops at the first axis that separates them.
bool overlap(const Aabb& a, const Aabb& b);

/// The smallest box around a shape.
Aabb bounds(const Shape& shape, const BodyState& state);

/// A body in the eyes of the broadphase.
struct Proxy {
  Aabb box;
  int body = 0;          ///< index, unique among the proxies
  bool movable = false;  ///< two immovable ones make no pair
};

/// Stage 1 of a step: which bodies may touch. A balanced tree of boxes, rebuilt in each call by
/// splitting at the median, is tested against itself and against another one, of what does not
/// move, that is kept. Unbounded boxes would spoil a tree and are tested one by one. A call
/// allocates only where it needs more room than all before it.
class Broadphase {
 public:
  using Pair = std::pair<int, int>;  ///< body indices, first < second

  /// From now on these are there as well. No pair is made of two of them. Forgets the last pairs.
  void set_resting(const List<Proxy>& proxies);

  /// All pairs, of these and of these with resting ones, with at least one movable body whose boxes
  /// overlap, sorted; of more than kMostPairs only some. Valid until the next call.
  const List<Pair>& find_pairs(const List<Proxy>& proxies);

  /// What the last call found.
  const List<Pair>& pairs() const { return pairs_; }

  /// Whether there are more pairs than can be reported.
  bool is_full() const { return pairs_.size() > kMostPairs; }

  /// Box against box tests of the last call, those of the tree's inner boxes included.
  std::uint64_t tests() const { return tests_; }

 private:
  /// A leaf of the tree to be.
  struct Item {
    Eigen::Vector3d centre;  ///< twice the centre of its box [m]
    int proxy = 0;           ///< index
  };

  /// A box around `leaves` proxies. Nodes lie in preorder: the left child, which has the smaller
  /// half of the leaves, follows its parent, and the right child follows the left one's subtree.
  struct Node {
    Aabb box;
    int leaves = 0;
    int body = 0;          ///< of a leaf
    bool movable = false;  ///< whether any of its proxies is
  };

  /// Of the bounded proxies; the others are beside it.
  struct Tree {
    List<Item> items;
    List<Node> nodes;  ///< from the root; none without items
    List<Proxy> unbounded;

    void build(const List<Proxy>& proxies);
    void build(const List<Proxy>& proxies, int node, int first_item, int leaves);
    static int left_child(int node) { return node + 1; }
    int right_child(int node) const { return node + 2 * (nodes[node].leaves / 2); }
    const Node& operator[](int node) const { return nodes[node]; }
  };

  void pair_within(const Tree& tree, int node);
  void pair_between(const Tree& tree_a, int node_a, const Tree& tree_b, int node_b);
  void pair_with(const Proxy& proxy, const Tree& tree);
  void pair_proxies(const Proxy& a, const Proxy& b);
  bool test(const Aabb& a, const Aabb& b);
  void add_pair(int body_a, int body_b);

  Tree moving_, resting_;
  List<Pair> pairs_;
  std::uint64_t tests_ = 0;
};

}  // namespace constraint_sim::engine
