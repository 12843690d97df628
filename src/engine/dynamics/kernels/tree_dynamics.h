#pragma once

#include <Eigen/Core>
#include <cstddef>

#include "engine/dynamics/kernels/composite_inertia.h"
#include "engine/dynamics/kernels/joint_tree.h"
#include "engine/dynamics/kernels/spatial_inertia.h"
#include "engine/math/lanes.h"
#include "engine/math/list.h"

namespace constraint_sim::engine {

/// Motion of the point that a tree hangs on, in world axes. A free tree moves from its root.
struct TreeRoot {
  Eigen::Matrix3d axes = Eigen::Matrix3d::Identity();
  Eigen::Vector3d velocity = Eigen::Vector3d::Zero();          ///< [m/s]
  Eigen::Vector3d acceleration = Eigen::Vector3d::Zero();      ///< [m/s²]
  Eigen::Vector3d angular_velocity = Eigen::Vector3d::Zero();  ///< constant [rad/s]
};

/// Equations of motion of a JointTree: H ẍ = b for the unknown motions. H follows from the
/// composite inertias of subtrees (Featherstone, Rigid Body Dynamics Algorithms (2008), chapter 6).
/// Spatial vectors are in world axes; their point of reference, the origin of a tree, is where its
/// root hangs, or the centre of a free root, at the time of the evaluation. Motions that follow
/// others by couplings have no unknown of their own: ẍ = factor · ẍ of the source.
class TreeDynamics {
 public:
  TreeDynamics() = default;
  explicit TreeDynamics(const JointTree& tree);

  /// Places all bodies at state y. `roots`: per body, of its tree.
  void place(const JointTree& tree, const List<TreeRoot>& roots, const double* y);
  /// Evaluates H and b after place(). `acceleration` [m/s²] and `torque` [N m] per body of the
  /// island are those of gravity and loads.
  void evaluate(const JointTree& tree, const Eigen::Vector3d* acceleration,
                const Eigen::Vector3d* torque);
  /// Entry of H, after evaluate() and before solve(): row k, and the column of the motion with this
  /// depth among k and the motions before it.
  double entry(std::size_t k, std::size_t depth) const { return H_[k * direction_.size() + depth]; }
  /// Solves for ẍ of the unknown motions.
  void solve(const JointTree& tree);
  /// Replaces forces on motions by H⁻¹ of them, with the factors of the last solve(). Numbers of
  /// prescribed motions stay.
  void apply_inverse(const JointTree& tree, double* numbers) const;
  /// Adds a wrench about the origin on a body, after evaluate(), to the right-hand side and to what
  /// joints transmit. After solve() the right-hand side is no longer read.
  void add_wrench(const JointTree& tree, std::size_t body, const SpatialVector& wrench);
  /// Adds to ẍ of all unknown motions, after solve().
  void add_to_accelerations(const double* change);
  /// Least share of a pivot of the last solve() in its diagonal entry.
  double least_pivot(const JointTree& tree) const;
  /// Evaluates what joints transmit, after solve().
  void find_transmitted(const JointTree& tree);

  /// Position of a node and axes of its frame, relative to the origin [m].
  struct Placed {
    Eigen::Matrix3d axes;
    Eigen::Matrix3d axes_before;  ///< axes of the joint on the parent, before its motions
    Eigen::Vector3d point, centre;
    Eigen::Vector3d point_before;  ///< anchor on the parent
    SpatialVector motion;          ///< velocity of the point at the origin, angular velocity
    SpatialVector bias;            ///< acceleration with zero ẍ of unknown motions
  };
  const Placed& placed(std::size_t body) const { return placed_[body]; }
  /// Velocity of the centre of a body [m/s].
  Eigen::Vector3d velocity(std::size_t body) const {
    const Placed& at = placed_[body];
    return at.motion.linear + at.motion.angular.cross(at.centre);
  }
  /// Direction of a motion as a spatial vector.
  const SpatialVector& direction(std::size_t motion) const { return direction_[motion]; }
  /// Force on each unknown motion, besides those of evaluate() [N or N m]; set before evaluate().
  double& force(std::size_t motion) { return force_[motion]; }
  /// ẍ of each motion; of prescribed ones set before place().
  double& acceleration(std::size_t motion) { return acceleration_[motion]; }
  double acceleration(std::size_t motion) const { return acceleration_[motion]; }
  /// Force and torque about the origin on the subtree of a body by its joint.
  const SpatialVector& transmitted(std::size_t body) const { return transmitted_[body]; }
  /// Writes the momenta of all bodies, about the origin, and their inertia there.
  void find_momentum(const JointTree& tree, SpatialVector* momentum,
                     CompositeInertia* inertia) const;
  /// Evaluates added() for the accelerations ẍ of the unknown motions.
  void add_accelerations(const JointTree& tree) const {
    add_along_branches(tree, unknown_acceleration_.data());
  }
  /// Part of the motion of a body that rates or accelerations of the motions along its branch add.
  const SpatialVector& added(std::size_t body) const { return added_[body]; }
  /// Returns the largest square of a displacement by a small change of all motions [m²]. Centres of
  /// mass count, and points at the radius of gyration.
  double squared_size_of(const JointTree& tree, const double* change) const;

 private:
  /// Evaluates added() for rates of all motions.
  void add_along_branches(const JointTree& tree, const double* rates) const;
  /// Row k of H: an entry for each motion before motion k by its depth, then the diagonal one.
  double* row(std::size_t k) { return H_.data() + k * direction_.size(); }
  const double* row(std::size_t k) const { return H_.data() + k * direction_.size(); }
  void factor(const JointTree& tree, double* forces);
  void substitute(const JointTree& tree, double* numbers) const;
  void factor_coupled(const JointTree& tree);
  void apply_coupled_inverse(const JointTree& tree, const double* forces, double* numbers) const;
  void find_own(const JointTree& tree, std::size_t first, const Eigen::Vector3d* acceleration,
                const Eigen::Vector3d* torque);
  void place_node(const TreeBody& body, const TreeMotion* motions, const double* y,
                  const double* rates, Placed* at);

  List<Placed> placed_;                // per body
  List<Lanes33> inertia_;              // per two bodies, in axes of their nodes
  List<SpatialVector> direction_;      // per motion
  List<double> force_, acceleration_;  // per motion
  List<double> unknown_acceleration_;  // per motion, 0 where it is prescribed
  List<CompositeInertia> composite_;   // per body, of its subtree
  List<SpatialVector> transmitted_;    // per body
  List<SpatialVector> moved_;          // per motion: composite inertia × direction
  mutable List<SpatialVector> added_;  // per body: result of add_along_branches()
  List<SpatialVector> subtree_;        // per body: force by the unknown motions of its subtree
  List<double> H_, b_;                 // rows of H, right-hand side
  List<double> reduced_;               // H of independent motions, then its factors
  mutable List<double> reduced_b_;     // forces on independent motions
  List<std::size_t> place_of_;         // place of the independent motion in these, per motion
  List<double> diagonal_;              // diagonal of H, per motion
};

}  // namespace constraint_sim::engine
