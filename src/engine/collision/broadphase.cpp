#include "engine/collision/broadphase.h"

#include <algorithm>

#include "engine/collision/convex.h"
#include "engine/math/list.h"
#include "engine/math/numbers.h"

namespace constraint_sim::engine {
namespace {

/// Half the extent of a shape along the world's axes [m].
struct HalfExtent {
  const BodyState& state;

  Eigen::Vector3d operator()(const Point&) const { return Eigen::Vector3d::Zero(); }
  Eigen::Vector3d operator()(const Sphere& sphere) const {
    return Eigen::Vector3d::Constant(sphere.radius);
  }
  Eigen::Vector3d operator()(const Box& box) const {
    return state.orientation.toRotationMatrix().cwiseAbs() * (0.5 * box.size);
  }
  Eigen::Vector3d operator()(const Cylinder& cylinder) const {
    const Eigen::Matrix3d R = state.orientation.toRotationMatrix();
    return cylinder.radius * R.leftCols<2>().rowwise().norm() +
           0.5 * cylinder.length * R.col(2).cwiseAbs();
  }
  Eigen::Vector3d operator()(const Capsule& capsule) const {
    const Eigen::Vector3d along = state.orientation * Eigen::Vector3d::UnitZ();
    return (0.5 * capsule.length * along.cwiseAbs()).array() + capsule.radius;
  }
  Eigen::Vector3d operator()(const Plane&) const { return Eigen::Vector3d::Constant(kInfinity); }
  // The bounding box is symmetric about the centre of the hull. Each half extent is the largest
  // distance of a vertex along that world axis.
  Eigen::Vector3d operator()(const Hull& hull) const {
    const Eigen::Matrix3d R = state.orientation.toRotationMatrix();
    Eigen::Vector3d most = Eigen::Vector3d::Zero();
    for (const Eigen::Vector3d& vertex : hull.surface->vertices())
      most = most.cwiseMax((R * vertex).cwiseAbs());
    return most;
  }
};

bool is_bounded(const Aabb& box) { return box.min.allFinite() && box.max.allFinite(); }

Aabb merged(const Aabb& a, const Aabb& b) { return {a.min.cwiseMin(b.min), a.max.cwiseMax(b.max)}; }

double girth(const Aabb& box) { return (box.max - box.min).sum(); }

}  // namespace

Aabb bounds(const Shape& shape, const BodyState& state) {
  const Eigen::Vector3d half = visit_convex(HalfExtent{state}, shape);
  return {state.position - half, state.position + half};
}

void Broadphase::set_resting(const List<Proxy>& proxies) {
  resting_.build(proxies);
  pairs_.clear();
}

const List<Broadphase::Pair>& Broadphase::find_pairs(const List<Proxy>& proxies) {
  tests_ = 0;
  pairs_.clear();
  moving_.build(proxies);

  if (!moving_.nodes.empty()) {
    pair_within(moving_, 0);
    if (!resting_.nodes.empty()) pair_between(moving_, 0, resting_, 0);
  }
  for (std::size_t i = 0; i < moving_.unbounded.size(); ++i) {
    const Proxy& unbounded = moving_.unbounded[i];
    pair_with(unbounded, moving_);
    pair_with(unbounded, resting_);
    for (std::size_t j = 0; j < i; ++j) pair_proxies(unbounded, moving_.unbounded[j]);
    for (const Proxy& other : resting_.unbounded) pair_proxies(unbounded, other);
  }
  for (const Proxy& unbounded : resting_.unbounded) pair_with(unbounded, moving_);

  std::sort(pairs_.begin(), pairs_.end());
  return pairs_;
}

void Broadphase::Tree::build(const List<Proxy>& proxies) {
  items.clear();
  unbounded.clear();
  for (std::size_t i = 0; i < proxies.size(); ++i) {
    const Aabb& box = proxies[i].box;
    if (is_bounded(box)) {
      items.push_back({box.min + box.max, static_cast<int>(i)});
    } else {
      unbounded.push_back(proxies[i]);
    }
  }
  nodes.resize(items.empty() ? 0 : 2 * items.size() - 1);
  if (!items.empty()) build(proxies, 0, 0, static_cast<int>(items.size()));
}

void Broadphase::Tree::build(const List<Proxy>& proxies, int node, int first_item, int leaves) {
  if (leaves == 1) {
    nodes[node] = {proxies[items[first_item].proxy], 1};
    return;
  }
  nodes[node].leaves = leaves;
  const int half = leaves / 2;
  if (leaves > 2) halve(first_item, leaves);  // two leaves make one pair in any order
  build(proxies, left_child(node), first_item, half);
  build(proxies, right_child(node), first_item + half, leaves - half);
  const Proxy& left = nodes[left_child(node)].proxy;
  const Proxy& right = nodes[right_child(node)].proxy;
  nodes[node].proxy = {merged(left.box, right.box), 0, left.movable || right.movable, 0, 0, 0};
}

// Moves the smaller half of the items to the front, along the axis along which the centres spread
// most.
void Broadphase::Tree::halve(int first_item, int leaves) {
  const auto first = items.begin() + first_item;
  Eigen::Vector3d lowest = first->centre;
  Eigen::Vector3d highest = first->centre;
  for (auto item = first + 1; item != first + leaves; ++item) {
    lowest = lowest.cwiseMin(item->centre);
    highest = highest.cwiseMax(item->centre);
  }
  int axis = 0;
  (highest - lowest).maxCoeff(&axis);

  // Ties are decided by index, so that both halves do not depend on the library's nth_element.
  const auto before = [axis](const Item& a, const Item& b) {
    if (a.centre[axis] != b.centre[axis]) return a.centre[axis] < b.centre[axis];
    return a.proxy < b.proxy;
  };
  std::nth_element(first, first + leaves / 2, first + leaves, before);
}

void Broadphase::pair_within(const Tree& tree, int node) {
  if (tree[node].leaves == 1 || !tree[node].proxy.movable || is_full()) return;
  pair_within(tree, Tree::left_child(node));
  pair_within(tree, tree.right_child(node));
  pair_between(tree, Tree::left_child(node), tree, tree.right_child(node));
}

void Broadphase::pair_between(const Tree& tree_a, int node_a, const Tree& tree_b, int node_b) {
  const auto& [a, leaves_a] = tree_a[node_a];
  const auto& [b, leaves_b] = tree_b[node_b];
  if ((!a.movable && !b.movable) || is_full()) return;
  if (!test(a.box, b.box)) return;

  // Splitting the larger box keeps a large body from being tested against every node on every
  // level.
  if (leaves_a == 1 && leaves_b == 1) {
    add_pair(a, b);
  } else if (leaves_b == 1 || (leaves_a > 1 && girth(a.box) > girth(b.box))) {
    pair_between(tree_a, Tree::left_child(node_a), tree_b, node_b);
    pair_between(tree_a, tree_a.right_child(node_a), tree_b, node_b);
  } else {
    pair_between(tree_a, node_a, tree_b, Tree::left_child(node_b));
    pair_between(tree_a, node_a, tree_b, tree_b.right_child(node_b));
  }
}

// Pairs an unbounded proxy with all leaves.
void Broadphase::pair_with(const Proxy& proxy, const Tree& tree) {
  for (const Node& node : tree.nodes)
    if (node.leaves == 1 && !is_full()) pair_proxies(proxy, node.proxy);
}

void Broadphase::pair_proxies(const Proxy& a, const Proxy& b) {
  if (!a.movable && !b.movable) return;
  if (test(a.box, b.box)) add_pair(a, b);
}

bool Broadphase::test(const Aabb& a, const Aabb& b) {
  ++tests_;
  return overlap(a, b);
}

void Broadphase::add_pair(const Proxy& a, const Proxy& b) {
  if (a.body == b.body || !share_a_group(a.groups, a.mask, b.groups, b.mask)) return;
  const Proxy &first = a.body < b.body ? a : b, &second = a.body < b.body ? b : a;
  pairs_.push_back({first.body, second.body, first.part, second.part});
}

}  // namespace constraint_sim::engine
