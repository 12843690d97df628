#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <cstdint>

#include "engine/dynamics/island_model.h"
#include "engine/dynamics/kernels/body_tree.h"
#include "engine/dynamics/kernels/tree_node.h"
#include "engine/math/list.h"

namespace constraint_sim::engine {

/// Stands for no body, joint, row or motion.
inline constexpr std::size_t kNoIndex = TreeNode::kNone;

/// One-dimensional motion of a child relative to its parent, along or about an axis of a frame that
/// the motions before it move: a shift x along the axis, or a turn x about it. The coordinate of
/// the joint is x where the child is body B, and −x where the child is body A.
struct TreeMotion {
  bool turns = false;
  std::uint8_t axis = 0;     ///< 0 to 2: x, y, z of the moved frame
  double sense = 1.0;        ///< −1 where the child is body A
  std::size_t position = 0;  ///< index of x in a state; its rate is at JointTree::rate_at + index
  std::size_t before = kNoIndex;  ///< next motion towards the root that is not prescribed
  std::size_t depth = 0;          ///< number of such motions towards the root
  bool is_prescribed = false;     ///< by a motor, or by a coupling with such a motion
  std::size_t source = kNoIndex;  ///< motion that this one follows by couplings
  double factor = 1.0;            ///< ẋ over that of the source
  std::size_t row = kNoIndex;     ///< row of the motor that prescribes x
  std::size_t soft = kNoIndex;    ///< index in soft_coordinates()
  int coordinate = -1;            ///< index of the joint's coordinate; −1: none
};

/// A coupling, which sets motion `from` by motion `to`: Σ ratio x is constant.
struct TreeCoupling {
  std::size_t coupled = 0;       ///< index in coupled_rows()
  std::size_t from = 0, to = 0;  ///< motions
  std::size_t from_term = 0;     ///< which of both terms of the row is `from`
  double from_ratio = 1.0, to_ratio = 1.0;
  double zero = 0.0;  ///< Σ ratio q₀, q₀: the coordinate q where its form is 0
};

/// Joint that closes a loop of a JointTree, by rows between two bodies.
struct ClosingJoint {
  struct End {
    std::size_t body = kNoIndex;   ///< index in JointTree::bodies; a fixed point has none
    std::size_t point = kNoIndex;  ///< index in the island, of a fixed point
    Eigen::Matrix3d axes;          ///< axes of the joint in the node, or on the fixed point
    Eigen::Vector3d anchor;        ///< in the node [m]; on the fixed point 0
  };
  std::size_t link = 0;
  End a, b;
};

/// A row of a joint as a component of what the joint transmits to the child.
struct TransmittedRow {
  enum class Along : std::uint8_t {
    kWorld,   ///< an axis of the world
    kBefore,  ///< an axis of the joint on the parent
    kNode,    ///< an axis of the node
    kAcross,  ///< second × first axis of a universal joint, in the order of its motions
  };
  Along along = Along::kWorld;
  std::uint8_t axis = 0;
  /// Whether it is a component of the torque about the anchor on body B, else of the force.
  bool is_torque = false;
  double sign = 1.0;
  std::size_t row = 0;  ///< index in the island
};

/// Body of a JointTree. Its node is a frame at the joint: the frame of the joint on the child.
struct TreeBody {
  std::size_t body = 0;                    ///< index in the island
  std::size_t parent = kNoIndex;           ///< index in JointTree::bodies
  std::size_t link = kNoIndex;             ///< joint to the parent; a free root has none
  std::size_t fixed = kNoIndex;            ///< fixed point that the root hangs on
  bool is_a = false;                       ///< whether the body is end A of its joint
  std::size_t first_row = 0, end_row = 0;  ///< range in JointTree::rows
  std::size_t first = 0, end = 0;          ///< range of motions
  /// Whether the last three motions are a rotation in all directions, by a quaternion.
  bool turns_freely = false;
  std::size_t quaternion = kNoIndex;  ///< index of the quaternion in a state

  Eigen::Matrix3d axes_of_parent;   ///< axes of the joint on the parent, in the parent's node
  Eigen::Vector3d place_in_parent;  ///< anchor on the parent, in the parent's node [m]
  Eigen::Matrix3d axes_of_body;     ///< axes of the body, in the node
  Eigen::Vector3d centre;           ///< centre of mass in the node [m]
  double mass = 0.0;                ///< [kg]
  Eigen::Matrix3d inertia;          ///< about the centre, in axes of the node [kg m²]
  double squared_gyration = 0.0;    ///< square of the largest radius of gyration [m²]

  /// Whether a motion of this body is part of the rotation in all directions.
  bool is_of_rotation(std::size_t motion) const { return turns_freely && motion + 3 >= end; }
};

/// Trees of bodies by the coordinates of their joints; couplings and closing joints may join
/// several. A state holds
/// the positions x of all motions and the quaternions (x, y, z, w) of rotations by three angles,
/// then the rates of all motions; rates of such a rotation are angular velocities about the axes of
/// the child's node.
struct JointTree {
  List<TreeBody> bodies;  ///< parents before their children
  List<TreeMotion> motions;
  List<TransmittedRow> rows;
  List<TreeCoupling> couplings;  ///< `to` before what follows it
  List<ClosingJoint> closings;
  List<std::size_t> independent;  ///< motions that are neither prescribed nor follow others
  std::size_t rate_at = 0;        ///< number of positions, which is even
  std::size_t size = 0;           ///< numbers of a state, even
  bool has_quaternions = false;

  bool is_free() const { return bodies.front().fixed == kNoIndex; }
  /// Whether only loads change the momenta of the whole.
  bool keeps_momenta() const;
};

/// Returns the trees of an island by joint coordinates. Empty where `tree` is empty, where a child
/// is end A of a joint with shifts and a turn by three angles, and where couplings form a loop or
/// have a term on a joint that closes one.
JointTree whole_joint_tree_of(const IslandModel& island, const BodyTree& tree);

/// Returns likewise the trees that are integrated by joint coordinates. Empty also where so many
/// coordinates or loops are not worth dense matrices, and where more than half of the bodies turn
/// by three angles, whose errors are smaller with angular momenta as the state.
JointTree joint_tree_of(const IslandModel& island, const BodyTree& tree);

}  // namespace constraint_sim::engine
