#pragma once

#include "engine/dynamics/equations_of_motion.h"

namespace constraint_sim::engine {

/// Pointers to the data of EquationsOfMotion that kernels share, valid for one interval. A kernel
/// implements System for islands of one common shape.
struct KernelView {
  const IslandModel::Row* rows;
  const std::size_t* unknown;                       ///< per row
  std::size_t v_at, q_at, L_at;                     ///< offsets in a state vector; x is at 0
  const Prescribed* lengths;                        ///< per link
  const double* inverse_mass;                       ///< per point
  const Eigen::Vector3d* applied_acceleration;      ///< per point
  const Eigen::Vector3d* applied_torque;            ///< per rotating body
  const double *rate_target, *acceleration_target;  ///< per row
  double scale;                                     ///< length that rounding is relative to [m]

  // Results of the last evaluation.
  Eigen::Vector3d *position, *velocity;  ///< per point
  Eigen::Matrix3d* orientation;          ///< per rotating body
  Eigen::Vector3d* angular_velocity;     ///< per rotating body
  Eigen::Vector3d* rod_direction;        ///< d, per rod
  Eigen::Vector3d* separation;           ///< d, per link; of ball joints
  JointVectors* vectors;                 ///< per general joint
  double* placed_at;                     ///< time of the last evaluation [s]
  CoordinatePositions* coordinates;

  double* solution;                 ///< by unknown
  double *impulses, *stage_forces;  ///< by unknown; stage_forces stage by stage
  std::size_t unknowns;

  // Compiled data of single kernels.
  TridiagonalLdlt* tridiagonal;
  Eigen::Vector3d* falls;  ///< per rod of a chain: free acceleration of B minus A
  ChainPair* pairs;
  BodyTree* tree;
};

/// Base of kernels whose state vector, error and sums are those of the equations.
class EquationsKernel {
 public:
  std::size_t size() const { return equations_.size(); }
  template <class Pair>
  void accept(double h) {
    equations_.accept<Pair>(h);
  }
  double rounding() const { return equations_.rounding(); }
  double squared_size_of(const double* dy, double h, bool /*is_of_rates*/ = false) const {
    return equations_.squared_size_of(dy, h);
  }

 protected:
  explicit EquationsKernel(EquationsOfMotion& equations) : equations_(equations) {}

  EquationsOfMotion& equations_;
};

inline void Kinematics::lend(KernelView* view) {
  view->position = position_.data();
  view->velocity = velocity_.data();
  view->orientation = orientation_.data();
  view->angular_velocity = angular_velocity_.data();
  view->rod_direction = J_linear_.data();
  view->separation = separation_.data();
  view->vectors = vectors_.data();
  view->placed_at = &time_;
}

inline KernelView EquationsOfMotion::kernel_view() {
  KernelView view{};
  kinematics_.lend(&view);
  view.rows = rows_.data();
  view.unknown = delassus_.unknown().data();
  view.v_at = layout().v_at;
  view.q_at = layout().q_at;
  view.L_at = layout().L_at;
  view.lengths = inputs_.length().data();
  view.inverse_mass = inverse_mass_.data();
  view.applied_acceleration = inputs_.acceleration().data();
  view.applied_torque = inputs_.torque().data();
  view.rate_target = inputs_.rate_target().data();
  view.acceleration_target = inputs_.acceleration_target().data();
  view.scale = scale_;
  view.coordinates = &coordinates_;
  view.solution = solution_.data();
  view.impulses = forces_.impulses();
  view.stage_forces = forces_.stage(0);
  view.unknowns = forces_.unknowns();
  view.tridiagonal = &tridiagonal_;
  view.falls = falls_.data();
  view.pairs = pairs_.data();
  view.tree = &tree_;
  return view;
}

}  // namespace constraint_sim::engine
