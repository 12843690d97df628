#include "engine/islands/topology.h"

#include <algorithm>

#include "engine/constraints/joint.h"
#include "engine/constraints/joint_kinds.h"
#include "engine/math/disjoint_sets.h"

namespace constraint_sim::engine {

JointEnds ends_of(const Model& model, const Joint& joint) {
  return {model.index(joint.body_a), model.index(joint.body_b)};
}

List<IslandMembers> group_bodies(const Model& model, const List<JointData>& joint_states,
                                 const List<JointEnds>& ends) {
  List<bool> movable, acting;
  for (std::size_t i = 0; i < model.bodies.size(); ++i) movable.push_back(model.is_movable(i));
  for (std::size_t j = 0; j < model.joints.size(); ++j)
    acting.push_back(acts(model.joints[j], joint_states[j]));
  return find_islands(movable, acting, ends);
}

void Topology::link_joints(const Model& model, const List<JointData>& joint_states) {
  joint_ends_.clear();
  unpaired_.clear();
  has_custom_forces_ = false;
  for (std::size_t j = 0; j < model.joints.size(); ++j) {
    const Joint& joint = model.joints[j];
    const auto [a, b] = joint_ends_.emplace_back(ends_of(model, joint));
    has_custom_forces_ |= is_custom_force(joint.kind);
    if (!joint.collide_connected && acts(joint, joint_states[j]))
      unpaired_.emplace_back(static_cast<int>(std::min(a, b)), static_cast<int>(std::max(a, b)));
  }
  std::sort(unpaired_.begin(), unpaired_.end());
}

void Topology::set_islands(std::size_t bodies, const List<IslandParts>& islands) {
  island_of_.assign(bodies, -1);
  for (std::size_t i = 0; i < islands.size(); ++i)
    for (const int body : islands[i].members.bodies) island_of_[body] = static_cast<int>(i);
}

bool Topology::is_unpaired(const std::pair<int, int>& bodies) const {
  return std::binary_search(unpaired_.begin(), unpaired_.end(), bodies);
}

// A joint between bodies that others connect already closes a loop. Immovable bodies count as one.
void Topology::find_loops(const Model& model, const List<JointData>& joint_states,
                          const List<IslandParts>& islands) {
  List<bool> has_loop(islands.size(), false);
  DisjointSets<std::size_t> connected(model.bodies.size());
  const auto member = [&](std::size_t body) {
    return model.is_movable(body) ? body : std::size_t{0};
  };
  for (std::size_t j = 0; j < model.joints.size(); ++j) {
    const Joint& joint = model.joints[j];
    if (!acts(joint, joint_states[j]) || !is_always_rigid(joint)) continue;
    if (info(joint.kind).couples_joints) continue;
    const auto [a, b] = joint_ends_[j];
    if (!connected.join(member(a), member(b))) has_loop[island_of_joint(model, j)] = true;
  }
  is_in_loop_.assign(model.joints.size(), false);
  for (std::size_t i = 0; i < islands.size(); ++i)
    if (has_loop[i])
      for (const int j : islands[i].members.joints) is_in_loop_[j] = true;
}

}  // namespace constraint_sim::engine
