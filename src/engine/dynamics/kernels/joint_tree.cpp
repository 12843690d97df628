#include "engine/dynamics/kernels/joint_tree.h"

#include <algorithm>
#include <array>

namespace constraint_sim::engine {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;

// Entries of H and of the matrices of loops beyond which the elimination of TreeOfBodies is
// cheaper. A chain of 24 hinges has as many; there both take as many instructions. A free robot
// with 30 motions on four limbs has fewer.
constexpr std::size_t kMostTreeEntries = 300;

std::size_t next_even(std::size_t n) { return n + n % 2; }

/// Frame and anchor of a joint on one of its ends.
struct JointFrame {
  Matrix3d axes = Matrix3d::Identity();
  Vector3d anchor = Vector3d::Zero();
};

JointFrame frame_on(const IslandModel::Link& link, bool on_a) {
  JointFrame frame;
  frame.anchor = on_a ? link.anchor_a : link.anchor_b;
  if (!info(link.kind).has_frames) return frame;
  const Matrix3d home_to_b = home(forms(link.kind).alignment).toRotationMatrix();
  frame.axes = on_a ? link.frame_a : Matrix3d(link.frame_b * home_to_b.transpose());
  return frame;
}

/// Lists the motions of a node in the order from the parent to the child, and returns whether the
/// last three are a rotation by three angles.
bool add_motions(const TreeNode& node, List<TreeMotion>* motions) {
  const std::size_t first = motions->size();
  std::size_t turns = 0;
  const auto add = [&](std::size_t k, std::uint8_t axis, bool is_coordinate) {
    const TreeNode::Direction& from = node.directions[k];
    TreeMotion motion;
    motion.turns = from.turns;
    motion.axis = axis;
    motion.sense = node.sense;
    motion.row = from.row;
    motion.is_prescribed = from.row != kNoIndex;
    motion.soft = from.soft;
    motion.coordinate = is_coordinate ? static_cast<int>(k) : -1;
    motions->push_back(motion);
  };
  for (std::size_t k = 0; k < node.count; ++k)
    if (const auto& from = node.directions[k]; !from.turns)
      add(k, from.axis % 4, from.axis < 4);  // world axes are numbered from 4
  for (std::size_t k = 0; k < node.count; ++k) {
    const TreeNode::Direction& from = node.directions[k];
    if (!from.turns) continue;
    ++turns;
    // After a turn about z_A the axis z_B of a universal joint is x of the moved frame.
    const std::uint8_t second = 0;
    add(k, from.axis < 3 ? from.axis : from.axis == 3 ? second : from.axis % 4, from.axis < 4);
  }
  // The motions that lead from A to B lead back from B to A in the reverse order.
  const bool is_rotation = turns == 3;
  if (node.sense < 0.0 && !is_rotation)
    std::reverse(motions->begin() + static_cast<std::ptrdiff_t>(first), motions->end());
  return is_rotation;
}

/// Adds the rows of a joint, which hold the poses of its frames that the motions allow. There the
/// axes z of both frames agree, or all axes, or z_B is normal to z_A.
void add_rows(const IslandModel& island, std::size_t l, bool is_a, List<TransmittedRow>* rows) {
  const JointForms& kind = forms(island.links()[l].kind);
  const std::size_t first = island.row_of(l);
  for (std::size_t k = 0; k < to_index(kind.rows); ++k) {
    const RowForm& form = kind.row[k];
    TransmittedRow row;
    row.row = first + k;
    row.sign = is_a ? -1.0 : 1.0;
    row.is_torque = !form.has_separation();
    const auto frame_of = [&](bool on_a) {
      return on_a == is_a ? TransmittedRow::Along::kNode : TransmittedRow::Along::kBefore;
    };
    if (!row.is_torque) {
      const VectorRef u = form.u.kind == VectorKind::kSeparation ? form.v : form.u;
      row.axis = u.axis;
      if (u.kind != VectorKind::kWorldAxis) row.along = frame_of(u.kind == VectorKind::kAxisA);
    } else if (kind.alignment == Alignment::kPerpendicularZ) {
      row.along = TransmittedRow::Along::kAcross;
      if (is_a) row.sign = -row.sign;
    } else {
      // The row u·v gives B the torque λ v × u. Here u and v are different axes of equal frames, so
      // the product is the third axis, or its negative where u does not follow v in x, y, z, x.
      row.along = frame_of(false);
      row.axis = static_cast<std::uint8_t>(3 - form.u.axis - form.v.axis);
      if ((form.v.axis + 1) % 3 != form.u.axis) row.sign = -row.sign;
    }
    rows->push_back(row);
  }
}

/// Returns the motion of a coordinate.
std::size_t motion_of(const JointTree& tree, std::size_t link, int coordinate) {
  for (const TreeBody& body : tree.bodies)
    for (std::size_t k = body.first; body.link == link && k < body.end; ++k)
      if (tree.motions[k].coordinate == coordinate) return k;
  return kNoIndex;
}

/// Lists the couplings outwards from one motion of each group of coupled motions: from a prescribed
/// one where there is any. Returns false where couplings form a loop or two motions of a group are
/// prescribed.
bool add_couplings(const IslandModel& island, JointTree* tree) {
  const auto& coupled = island.coupled_rows();
  List<char> is_listed(coupled.size(), 0), is_reached(tree->motions.size(), 0);
  const auto reach_from = [&](std::size_t start) {
    is_reached[start] = 1;
    List<std::size_t> queue{start};
    for (std::size_t next = 0; next < queue.size(); ++next) {
      const std::size_t to = queue[next];
      for (std::size_t c = 0; c < coupled.size(); ++c) {
        if (is_listed[c] != 0) continue;
        TreeCoupling made;
        std::array<std::size_t, 2> motions{};
        for (std::size_t k = 0; k < 2; ++k) {
          motions[k] = motion_of(*tree, coupled[c].terms[k].link, coupled[c].terms[k].coordinate);
          made.zero += coupled[c].terms[k].ratio * coupled[c].terms[k].zero;
        }
        if (motions[0] == kNoIndex || motions[1] == kNoIndex) return false;
        if (motions[0] != to && motions[1] != to) continue;
        made.coupled = c;
        made.from_term = motions[0] == to ? 1 : 0;
        made.from = motions[made.from_term];
        made.to = to;
        TreeMotion& from = tree->motions[made.from];
        const TreeMotion& of = tree->motions[to];
        if (is_reached[made.from] != 0 || from.row != kNoIndex) return false;
        made.from_ratio = from.sense * coupled[c].terms[made.from_term].ratio;
        made.to_ratio = of.sense * coupled[c].terms[1 - made.from_term].ratio;
        from.source = start;
        from.factor = -made.to_ratio / made.from_ratio * of.factor;
        from.is_prescribed = of.is_prescribed;
        is_listed[c] = is_reached[made.from] = 1;
        tree->couplings.push_back(made);
        queue.push_back(made.from);
      }
    }
    return true;
  };
  for (const bool is_prescribed : {true, false})
    for (std::size_t k = 0; k < tree->motions.size(); ++k)
      if (is_reached[k] == 0 && tree->motions[k].is_prescribed == is_prescribed && !reach_from(k))
        return false;
  return tree->couplings.size() == coupled.size();
}

/// Sets how a body hangs on its parent, whose frame at its own joint is `node_of_parent`.
void hang(const IslandModel& island, const TreeNode& node, const JointFrame& node_of_parent,
          TreeBody* body) {
  JointFrame on_body, on_parent;
  if (node.link != kNoIndex) {
    on_body = frame_on(island.links()[node.link], body->is_a);
    on_parent = frame_on(island.links()[node.link], !body->is_a);
  }
  body->axes_of_parent = on_parent.axes;
  body->place_in_parent = Vector3d::Zero();
  if (body->parent != kNoIndex) {
    const Matrix3d to_parent = node_of_parent.axes.transpose();
    body->axes_of_parent = to_parent * on_parent.axes;
    body->place_in_parent = to_parent * (on_parent.anchor - node_of_parent.anchor);
  }
  body->axes_of_body = on_body.axes.transpose();
  body->centre = -(body->axes_of_body * on_body.anchor);
  body->mass = 1.0 / island.inverse_mass(node.body);
  body->inertia =
      body->axes_of_body * island.inertia(node.body).asDiagonal() * body->axes_of_body.transpose();
  const double gyration = island.radius_of_gyration(node.body);
  body->squared_gyration = gyration * gyration;
}

/// Adds bodies, motions and rows. Returns false where a joint is no list of motions.
bool add_bodies(const IslandModel& island, const BodyTree& tree, JointTree* made) {
  List<std::size_t> place_of(island.bodies().size(), kNoIndex);
  for (std::size_t n = tree.nodes.size(); n-- > 0;) {
    const TreeNode& node = tree.nodes[n];
    TreeBody body;
    body.body = node.body;
    body.link = node.link;
    body.is_a = node.sense < 0.0;
    body.first = made->motions.size();
    body.turns_freely = add_motions(node, &made->motions);
    body.end = made->motions.size();
    // From B to A, shifts along axes of A would follow the rotation instead of going before it.
    if (body.turns_freely && body.is_a && body.end - body.first > 3) return false;
    body.first_row = made->rows.size();
    if (node.link != kNoIndex) add_rows(island, node.link, body.is_a, &made->rows);
    body.end_row = made->rows.size();
    JointFrame node_of_parent;
    if (node.link != kNoIndex && node.parent >= island.bodies().size()) {
      body.fixed = node.parent;
    } else if (node.link != kNoIndex) {
      body.parent = place_of[node.parent];
      const TreeBody& parent = made->bodies[body.parent];
      body.fixed = parent.fixed;
      if (parent.link != kNoIndex)
        node_of_parent = frame_on(island.links()[parent.link], parent.is_a);
    }
    hang(island, node, node_of_parent, &body);
    place_of[node.body] = made->bodies.size();
    made->bodies.push_back(body);
  }
  return true;
}

/// Lists the joints that close loops.
void add_closings(const IslandModel& island, const BodyTree& tree, JointTree* made) {
  List<std::size_t> place_of(island.bodies().size(), kNoIndex);
  for (std::size_t i = 0; i < made->bodies.size(); ++i) place_of[made->bodies[i].body] = i;
  for (const std::size_t l : tree.closings) {
    const IslandModel::Link& link = island.links()[l];
    const auto end_of = [&](std::size_t point, const Vector3d& anchor, const Matrix3d& frame) {
      ClosingJoint::End end;
      end.axes = frame;
      end.anchor = Vector3d::Zero();
      if (point >= place_of.size()) {
        end.point = point;
        return end;
      }
      end.body = place_of[point];
      const TreeBody& body = made->bodies[end.body];
      end.axes = body.axes_of_body * frame;
      end.anchor = body.centre + body.axes_of_body * anchor;
      return end;
    };
    made->closings.push_back({l, end_of(link.a, link.anchor_a, link.frame_a),
                              end_of(link.b, link.anchor_b, link.frame_b)});
  }
}

/// Returns the number of entries of H, and of the matrices of closing rows that are independent.
std::size_t entries_of(const IslandModel& island, const JointTree& tree) {
  std::size_t entries = 0, rows = 0;
  for (const TreeMotion& motion : tree.motions) entries += motion.depth + 1;
  for (const ClosingJoint& closing : tree.closings) rows += island.rows_of(closing.link);
  const std::size_t independent = tree.independent.size();
  rows = std::min(rows, independent);  // others depend on these
  return entries + rows * (rows + independent);
}

/// Sets the places of motions in a state, and the chain of unknown motions to the root.
void lay_out_state(JointTree* tree) {
  List<std::size_t> last_of(tree->bodies.size(), kNoIndex);
  for (std::size_t i = 0; i < tree->bodies.size(); ++i) {
    TreeBody& body = tree->bodies[i];
    std::size_t before = body.parent == kNoIndex ? kNoIndex : last_of[body.parent];
    for (std::size_t k = body.first; k < body.end; ++k) {
      TreeMotion& motion = tree->motions[k];
      motion.before = before;
      motion.depth = before == kNoIndex ? 0 : tree->motions[before].depth + 1;
      if (!motion.is_prescribed) before = k;
      if (!body.is_of_rotation(k)) motion.position = tree->rate_at++;
    }
    last_of[i] = before;
    if (!body.turns_freely) continue;
    body.quaternion = tree->rate_at;
    tree->rate_at += 4;
    tree->has_quaternions = true;
  }
  tree->rate_at = next_even(tree->rate_at);
  tree->size = next_even(tree->rate_at + tree->motions.size());
}

}  // namespace

bool JointTree::keeps_momenta() const {
  const auto is_on_fixed_point = [](const ClosingJoint& closing) {
    return closing.a.body == kNoIndex || closing.b.body == kNoIndex;
  };
  return is_free() && std::none_of(closings.begin(), closings.end(), is_on_fixed_point);
}

JointTree whole_joint_tree_of(const IslandModel& island, const BodyTree& tree) {
  JointTree made;
  if (!add_bodies(island, tree, &made) || !add_couplings(island, &made)) return {};
  if (made.motions.empty()) return {};  // no bodies, or only welds
  for (std::size_t k = 0; k < made.motions.size(); ++k)
    if (!made.motions[k].is_prescribed && made.motions[k].source == kNoIndex)
      made.independent.push_back(k);
  lay_out_state(&made);
  add_closings(island, tree, &made);
  return made;
}

JointTree joint_tree_of(const IslandModel& island, const BodyTree& tree) {
  if (island.is_chain_of_bodies()) return {};
  JointTree made = whole_joint_tree_of(island, tree);
  const auto turning = std::count_if(made.bodies.begin(), made.bodies.end(),
                                     [](const TreeBody& body) { return body.turns_freely; });
  const bool is_dear = entries_of(island, made) > kMostTreeEntries;
  return is_dear || 2 * to_index(turning) > made.bodies.size() ? JointTree{} : made;
}

}  // namespace constraint_sim::engine
