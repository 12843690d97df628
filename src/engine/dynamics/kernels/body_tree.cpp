#include "engine/dynamics/kernels/body_tree.h"

#include <algorithm>
#include <utility>

#include "engine/math/disjoint_sets.h"
#include "engine/math/list.h"

namespace constraint_sim::engine {
namespace {

/// Lists the free directions of a joint kind, B relative to A, coordinates first. Returns their
/// number.
std::size_t directions_of(const JointForms& kind, std::array<TreeNode::Direction, 6>* to) {
  std::size_t count = 0;
  const auto add = [&](bool turns, int axis) {
    (*to)[count].turns = turns;
    (*to)[count++].axis = static_cast<std::uint8_t>(axis);
  };
  bool has_turned = false;
  for (int i = 0; i < kind.coordinates; ++i) {
    const ScalarForm& form = kind.coordinate[i];
    if (form.is_angle)
      add(true, has_turned ? 3 : 2);
    else
      add(false, form.product.u.axis);
    has_turned = has_turned || form.is_angle;
  }
  if (kind.separation_rows == 0)  // translation without coordinates
    for (int k = 0; k < 3; ++k) add(false, 4 + k);
  if (kind.alignment == Alignment::kFree)
    for (int k = 0; k < 3; ++k) add(true, 4 + k);
  return count;
}

/// Whether rows and free directions of a kind span all six directions of motion. The elimination
/// requires it: a direction in neither list would be held without a row.
bool spans_all_directions(const JointForms& kind) {
  std::array<TreeNode::Direction, 6> directions;
  return kind.rows <= 6 &&
         to_index(kind.rows) + directions_of(kind, &directions) == directions.size();
}

/// Creates the node of a link, with the body that hangs on the joint.
TreeNode node_of(const IslandModel& island, std::size_t l, bool is_b) {
  const auto& link = island.links()[l];
  TreeNode node;
  node.link = l;
  node.body = is_b ? link.b : link.a;
  node.parent = is_b ? link.a : link.b;
  node.sense = is_b ? 1.0 : -1.0;
  node.count = directions_of(forms(link.kind), &node.directions);
  const int rows = forms(link.kind).rows;
  for (int k = rows; k < link.rows; ++k)
    node.directions[link.function[k] - to_index(rows)].row = island.row_of(l) + to_index(k);
  for (std::size_t s = link.first_soft; s < link.first_soft + link.softs; ++s)
    node.directions[island.soft_coordinates()[s].function - rows].soft = s;
  return node;
}

TreeNode free_root() {
  TreeNode root;
  for (std::size_t k = 0; k < 6; ++k) {
    root.directions[k].turns = k >= 3;
    root.directions[k].axis = static_cast<std::uint8_t>(4 + k % 3);
  }
  root.count = 6;
  return root;
}

std::size_t free_directions(const List<TreeNode>& tree) {
  std::size_t count = 0;
  for (const TreeNode& node : tree)
    for (std::size_t k = 0; k < node.count; ++k)
      count += node.directions[k].row == TreeNode::kNone ? 1 : 0;
  return count;
}

/// Flags the links that close loops: those that a largest tree leaves out, where joints with laws
/// come first, then those with more rows. All fixed points count as one body. Returns false where a
/// link can neither hang nor close.
bool find_closings(const IslandModel& island, List<char>* closes) {
  const auto& links = island.links();
  const std::size_t ground = island.bodies().size();
  List<std::size_t> order;
  for (std::size_t l = 0; l < links.size(); ++l) {
    const JointForms& kind = forms(links[l].kind);
    if (info(links[l].kind).couples_joints) continue;
    const bool is_rod = island.is_rod(l);
    if (is_rod) (*closes)[l] = 1;
    if (is_rod) continue;
    if (!island.is_by_offset(l) || kind.function[0].is_length || info(links[l].kind).is_custom ||
        !spans_all_directions(kind))
      return false;
    order.push_back(l);
  }
  const auto has_laws = [&](std::size_t l) {
    return links[l].softs > 0 || links[l].rows > forms(links[l].kind).rows;
  };
  std::stable_sort(order.begin(), order.end(), [&](std::size_t i, std::size_t j) {
    if (has_laws(i) != has_laws(j)) return has_laws(i);
    return forms(links[i].kind).rows > forms(links[j].kind).rows;
  });
  DisjointSets<std::size_t> connected(ground + 1);
  for (const std::size_t l : order) {
    const std::size_t a = std::min(links[l].a, ground), b = std::min(links[l].b, ground);
    if (!connected.join(a, b)) (*closes)[l] = 1;
  }
  return true;
}

}  // namespace

BodyTree tree_of(const IslandModel& island) {
  const auto& links = island.links();
  const std::size_t bodies = island.bodies().size();
  if (bodies == 0 || island.rotating() != bodies) return {};
  const auto is_fixed = [&](std::size_t point) { return point >= bodies; };
  BodyTree tree;
  List<char> closes(links.size(), 0);
  if (!find_closings(island, &closes)) return {};

  List<TreeNode>& nodes = tree.nodes;
  List<char> is_placed(bodies, 0);
  const auto place = [&](const TreeNode& node) {
    is_placed[node.body] = 1;
    nodes.push_back(node);
  };
  const auto hang = [&](std::size_t l, bool is_b) { place(node_of(island, l, is_b)); };
  List<List<std::size_t>> links_on(bodies);
  for (std::size_t l = 0; l < links.size(); ++l) {
    const auto& link = links[l];
    if (info(link.kind).couples_joints) continue;
    if (closes[l] != 0) {
      tree.closings.push_back(l);
      continue;
    }
    for (const std::size_t point : {link.a, link.b})
      if (!is_fixed(point)) links_on[point].push_back(l);
    if (is_fixed(link.a) || is_fixed(link.b)) hang(l, is_fixed(link.a));
  }
  const std::size_t roots = nodes.size();
  if (roots == 0) place(free_root());  // free island: the first body is the root
  std::size_t next = 0;
  while (next < nodes.size()) {  // hang() appends to nodes
    const std::size_t parent = nodes[next++].body;
    for (const std::size_t l : links_on[parent]) {
      const bool is_a = links[l].a == parent;
      const std::size_t other = is_a ? links[l].b : links[l].a;
      if (!is_fixed(other) && is_placed[other] == 0) hang(l, is_a);
    }
  }
  if (nodes.size() != bodies) return {};  // unconnected bodies
  std::reverse(nodes.begin(), nodes.end());
  tree.has_fewer_motions = tree.closings.empty() && island.coupled_rows().empty() && roots <= 1 &&
                           free_directions(nodes) < island.rows();
  tree.inertias.resize(bodies);
  tree.forces.resize(bodies);
  tree.motions.resize(bodies);
  return tree;
}

}  // namespace constraint_sim::engine
