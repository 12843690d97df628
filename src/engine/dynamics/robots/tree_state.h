#pragma once

#include <Eigen/Core>
#include <cstddef>

#include "constraint_sim/engine/body.h"
#include "engine/dynamics/kernels/joint_tree.h"
#include "engine/dynamics/kernels/tree_dynamics.h"
#include "engine/dynamics/robots/robot_tree.h"
#include "engine/math/list.h"

namespace constraint_sim::engine {

/// State of a RobotTree as read from the poses and velocities of its bodies.
///
/// The position of a shift is the component of the vector between both anchors along its axis; the
/// position of a turn is the angle between axes of both frames, in (−π, π]. Rates are components of
/// the relative velocity. Errors of the joints are left out of the state.
class TreeState {
 public:
  /// Reads the state. `states`: per body of the world. Immovable bodies keep their velocities.
  TreeState(const RobotTree& robot, const List<BodyState>& states);

  /// State as JointTree lays it out.
  const double* data() const { return y_.data(); }
  /// Motions of the points that the trees hang on, per body of the tree.
  const List<TreeRoot>& roots() const { return roots_; }
  /// Point of reference of the tree of a body: where its root hangs, or the centre of a free root,
  /// world frame [m].
  const Eigen::Vector3d& origin(std::size_t body) const { return origins_[body]; }
  /// Error of the joint that a body of the tree hangs on: distance from where its motions put the
  /// frame on the body [m], plus the angle between both orientations [rad].
  double opening(std::size_t body) const { return openings_[body]; }

 private:
  /// Frame of a joint on a body, relative to the origin of the tree, with its velocities.
  struct Frame {
    Eigen::Matrix3d axes;
    Eigen::Vector3d point, velocity, spin;
  };

  void place_root(const RobotTree& robot, const List<BodyState>& states, std::size_t i);
  Frame frame_of(const TreeBody& body, const BodyState& state, const Eigen::Vector3d& origin) const;
  Frame frame_before(const JointTree& tree, std::size_t i, const List<Frame>& nodes) const;
  void read_joint(const JointTree& tree, std::size_t i, const Frame& before, const Frame& node);

  List<double> y_;
  List<TreeRoot> roots_;
  List<Eigen::Vector3d> origins_;
  List<double> openings_;
};

}  // namespace constraint_sim::engine
