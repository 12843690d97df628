#pragma once

#include "engine/dynamics/equations_of_motion.h"

namespace constraint_sim::engine {

/// What the kernels share with EquationsOfMotion in a span of time: where the numbers stand. A
/// kernel is the same System for one common shape of islands. Points into the equations.
struct KernelView {
  const IslandModel::Row* rows;
  std::size_t v_at, q_at, L_at;                     ///< in a state, where x is at 0
  const Prescribed* lengths;                        ///< of links
  const double* inverse_mass;                       ///< of points
  const Eigen::Vector3d* applied_acceleration;      ///< of points
  const Eigen::Vector3d* applied_torque;            ///< of those that turn
  const double *rate_target, *acceleration_target;  ///< of rows
  double scale;                                     ///< what rounding goes by [m]

  // as of the last evaluation
  Eigen::Vector3d *position, *velocity;  ///< of points
  Eigen::Matrix3d* orientation;          ///< of those that turn
  Eigen::Vector3d* angular_velocity;     ///< of those that turn
  Eigen::Vector3d* rod_direction;        ///< d of rods
  Eigen::Vector3d* separation;           ///< d of ball joints, as links
  JointVectors* vectors;                 ///< of general joints
  double *placed_at, *noted_at;          ///< times of the last places, and of note_positions() [s]

  double* solution;                 ///< by unknown
  double *impulses, *stage_forces;  ///< by unknown; these stage by stage
  std::size_t unknowns;

  // what is compiled for one kernel
  TridiagonalLdlt* tridiagonal;
  Eigen::Vector3d* falls;  ///< of rods of a chain
  ChainPair* pairs;
  BodyTree* tree;
  IslandModel::SoftCoordinate* softs;
};

inline KernelView EquationsOfMotion::kernel_view() {
  KernelView view{};
  view.rows = rows_.data();
  view.v_at = v_at_;
  view.q_at = q_at_;
  view.L_at = L_at_;
  view.lengths = length_.data();
  view.inverse_mass = inverse_mass_.data();
  view.applied_acceleration = applied_acceleration_.data();
  view.applied_torque = applied_torque_.data();
  view.rate_target = rate_target_.data();
  view.acceleration_target = acceleration_target_.data();
  view.scale = scale_;
  view.position = position_.data();
  view.velocity = velocity_.data();
  view.orientation = orientation_.data();
  view.angular_velocity = angular_velocity_.data();
  view.rod_direction = direction_.data();
  view.separation = d_.data();
  view.vectors = vectors_.data();
  view.placed_at = &placed_at_;
  view.noted_at = &noted_at_;
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
