#pragma once

#include <cstddef>
#include <utility>

#include "engine/islands/island_parts.h"
#include "engine/math/list.h"
#include "engine/model/model.h"
#include "engine/model/state.h"

namespace constraint_sim::engine {

/// The two bodies of a joint, by index.
using JointEnds = std::pair<std::size_t, std::size_t>;

JointEnds ends_of(const Model& model, const Joint& joint);

/// Members of all islands that acting joints make of the bodies.
List<IslandMembers> group_bodies(const Model& model, const List<JointData>& joint_states,
                                 const List<JointEnds>& ends);

/// Which bodies joints connect, and the island of each body. Follows from a model and from which
/// joints act; rebuilt by the first step after an edit.
class Topology {
 public:
  /// Reads the ends of all joints, and which pairs of bodies joints keep from colliding.
  void link_joints(const Model& model, const List<JointData>& joint_states);
  /// Takes over the members of all islands, in their order.
  void set_islands(std::size_t bodies, const List<IslandParts>& islands);
  /// Finds the islands with a loop of joints.
  void find_loops(const Model& model, const List<JointData>& joint_states,
                  const List<IslandParts>& islands);

  const List<JointEnds>& joint_ends() const { return joint_ends_; }
  const JointEnds& ends(std::size_t joint) const { return joint_ends_[joint]; }
  const BodyState& state_a(const State& state, std::size_t joint) const {
    return state.states[joint_ends_[joint].first];
  }
  const BodyState& state_b(const State& state, std::size_t joint) const {
    return state.states[joint_ends_[joint].second];
  }
  /// Whether an acting joint without `collide_connected` connects two bodies, first < second.
  bool is_unpaired(const std::pair<int, int>& bodies) const;
  /// Index of the island of a body; -1 of immovable bodies.
  int island_of(std::size_t body) const { return island_of_[body]; }
  bool knows(std::size_t body) const { return body < island_of_.size(); }
  /// The island of a joint.
  std::size_t island_of_joint(const Model& model, std::size_t joint) const {
    const auto [a, b] = joint_ends_[joint];
    return to_index(island_of_[model.is_movable(a) ? a : b]);
  }
  /// By joint: whether joints of its island close a loop.
  const List<bool>& is_in_loop() const { return is_in_loop_; }
  /// Whether a joint has forces by a plugin.
  bool has_custom_forces() const { return has_custom_forces_; }

 private:
  List<JointEnds> joint_ends_;
  List<std::pair<int, int>> unpaired_;  // sorted
  List<int> island_of_;
  List<bool> is_in_loop_;
  bool has_custom_forces_ = false;
};

}  // namespace constraint_sim::engine
