#pragma once

#include <Eigen/Core>

#include "engine/dynamics/kernels/joint_tree.h"
#include "engine/dynamics/kernels/tree_dynamics.h"
#include "engine/math/list.h"

namespace constraint_sim::engine {

/// Loads on the bodies of an island, constant over an interval.
struct TreeLoads {
  const Eigen::Vector3d* acceleration;  ///< per body, by gravity and loads [m/s²]
  const Eigen::Vector3d* torque;        ///< per body [N m]
};

/// Momenta of a free tree.
struct TreeMomentum {
  double mass = 0.0;                                  ///< [kg]
  Eigen::Vector3d centre = Eigen::Vector3d::Zero();   ///< centre of mass relative to the root [m]
  Eigen::Vector3d linear = Eigen::Vector3d::Zero();   ///< [N s]
  Eigen::Vector3d angular = Eigen::Vector3d::Zero();  ///< about the centre of mass [N m s]
  Eigen::Matrix3d inertia = Eigen::Matrix3d::Zero();  ///< about the centre of mass [kg m²]

  TreeMomentum() = default;
  /// Takes the momenta where the bodies are placed.
  TreeMomentum(const JointTree& tree, const TreeDynamics& dynamics);

  /// Moves the tree at state y as a whole so that its momenta and its centre of mass are those that
  /// the loads give it in a substep of length h [s] from state `start`, and goes on with them.
  /// Momenta are not linear in the state, so that Runge-Kutta steps do not keep them.
  void keep(const JointTree& tree, const List<TreeRoot>& roots, const TreeLoads& loads, double h,
            const double* start, TreeDynamics* dynamics, double* y);
};

}  // namespace constraint_sim::engine
