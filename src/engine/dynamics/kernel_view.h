#pragma once

#include "engine/dynamics/equations_of_motion.h"

namespace constraint_sim::engine {

/// Pointers to the data of EquationsOfMotion that kernels share, valid for one interval. A kernel
/// implements System for islands of one common shape.
struct KernelView {
  const IslandModel::Row* rows;
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
  TurnedAngles* angles;                  ///< angles of general joints

  double* solution;                 ///< by unknown
  double *impulses, *stage_forces;  ///< by unknown; stage_forces stage by stage
  std::size_t unknowns;

  // Compiled data of single kernels.
  TridiagonalLdlt* tridiagonal;
  Eigen::Vector3d* falls;  ///< per rod of a chain: free acceleration of B minus A
  ChainPair* pairs;
  BodyTree* tree;
  IslandModel::SoftCoordinate* softs;
};

inline KernelView EquationsOfMotion::kernel_view() {
  KernelView view{};
  view.rows = rows_.data();
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
  view.position = position_.data();
  view.velocity = velocity_.data();
  view.orientation = orientation_.data();
  view.angular_velocity = angular_velocity_.data();
  view.rod_direction = direction_.data();
  view.separation = d_.data();
  view.vectors = vectors_.data();
  view.placed_at = &placed_at_;
  view.angles = &angles_;
  view.solution = solution_.data();
  view.impulses = impulses_.data();
  view.stage_forces = stage_forces_.data();
  view.unknowns = impulses_.size();
  view.tridiagonal = &tridiagonal_;
  view.falls = falls_.data();
  view.pairs = pairs_.data();
  view.tree = &tree_;
  view.softs = softs_.data();
  return view;
}

}  // namespace constraint_sim::engine
