#pragma once

#include <Eigen/Core>
#include <cstdint>

#include "constraint_sim/engine/body.h"
#include "constraint_sim/engine/report.h"
#include "engine/math/list.h"
#include "engine/model/shape_pair.h"

namespace constraint_sim::engine {

/// Axis-aligned bounding box in world coordinates [m]; infinite for a plane.
struct Aabb {
  Eigen::Vector3d min;
  Eigen::Vector3d max;
};

/// Whether each of two bodies or proxies is in a group with which the other collides.
inline bool share_a_group(std::uint32_t groups_a, std::uint32_t mask_a, std::uint32_t groups_b,
                          std::uint32_t mask_b) {
  return (groups_a & mask_b) != 0 && (groups_b & mask_a) != 0;
}

/// Whether two boxes share a point, touching included; ends at the first separating axis.
inline bool overlap(const Aabb& a, const Aabb& b) {
  for (int axis = 0; axis < 3; ++axis) {
    if (a.max[axis] < b.min[axis] || b.max[axis] < a.min[axis]) return false;
  }
  return true;
}

/// Returns the bounding box of a convex shape.
Aabb bounds(const Shape& shape, const BodyState& state);

/// Bounding box of a convex shape of a body in the broadphase.
struct Proxy {
  Aabb box;
  int body = 0;            ///< index; two proxies of a body make no pair
  bool movable = false;    ///< whether the body can move; a pair has at least one movable body
  std::uint16_t part = 0;  ///< number of the shape in its body, less than kMostParts
  std::uint32_t groups = 1, mask = kAllGroups;  ///< as of Body; the pair's must match
};

/// Stage 1 of a step: finds pairs of shapes that may touch. A balanced tree of boxes, rebuilt in
/// each call by median splits, is tested against itself and against a second tree of resting
/// proxies that is kept. Unbounded boxes would spoil a tree and are tested one by one. A call
/// allocates only where it needs more room than all calls before it.
class Broadphase {
 public:
  using Pair = ShapePair;

  /// Replaces the resting proxies, which make no pairs among themselves. Clears the pairs of the
  /// last call.
  void set_resting(const List<Proxy>& proxies);

  /// Returns all pairs with overlapping boxes and at least one movable body, among `proxies` and
  /// between them and resting ones, sorted; beyond kMostPairs only some. Valid until the next call.
  const List<Pair>& find_pairs(const List<Proxy>& proxies);

  /// Pairs of the last call.
  const List<Pair>& pairs() const { return pairs_; }

  /// Whether there are more pairs than kMostPairs.
  bool is_full() const { return pairs_.size() > kMostPairs; }

  /// Tests of a box against another in the last call, inner nodes of the tree included.
  std::uint64_t tests() const { return tests_; }

 private:
  /// A leaf while the tree is built.
  struct Item {
    Eigen::Vector3d centre;  ///< twice the centre of the box [m]
    int proxy = 0;           ///< index of the proxy
  };

  /// A box around `leaves` proxies. Nodes lie in preorder: the left child, with the smaller half of
  /// the leaves, follows its parent, and the right child follows the left child's subtree.
  struct Node {
    Proxy proxy;  ///< proxy of a leaf; else the box, and whether a proxy of the node is movable
    int leaves = 0;
  };

  /// Tree of the bounded proxies, with a list of unbounded ones.
  struct Tree {
    List<Item> items;
    List<Node> nodes;  ///< nodes in preorder; empty without items
    List<Proxy> unbounded;

    void build(const List<Proxy>& proxies);
    void build(const List<Proxy>& proxies, int node, int first_item, int leaves);
    void halve(int first_item, int leaves);
    static int left_child(int node) { return node + 1; }
    int right_child(int node) const { return node + 2 * (nodes[node].leaves / 2); }
    const Node& operator[](int node) const { return nodes[node]; }
  };

  void pair_within(const Tree& tree, int node);
  void pair_between(const Tree& tree_a, int node_a, const Tree& tree_b, int node_b);
  void pair_with(const Proxy& proxy, const Tree& tree);
  void pair_proxies(const Proxy& a, const Proxy& b);
  bool test(const Aabb& a, const Aabb& b);
  void add_pair(const Proxy& a, const Proxy& b);

  Tree moving_, resting_;
  List<Pair> pairs_;
  std::uint64_t tests_ = 0;
};

}  // namespace constraint_sim::engine
