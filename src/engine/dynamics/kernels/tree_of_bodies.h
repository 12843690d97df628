#pragma once

#include <Eigen/Geometry>
#include <cstddef>

#include "engine/dynamics/kernel_view.h"
#include "engine/math/list.h"

namespace constraint_sim::engine {

/// Kernel for rotating bodies on joints without a loop (is_tree()). Eliminates the free directions
/// of each joint from the articulated inertia of its subtree, from the leaves to the root
/// (Featherstone, Rigid Body Dynamics Algorithms (2008), chapter 7), so that a hinge costs one
/// pivot instead of a five-row matrix. Motions follow from the root to the leaves. The state holds
/// positions of bodies, which are projected as in EquationsOfMotion. Valid for one interval: points
/// into the equations.
class TreeOfBodies : public EquationsKernel {
 public:
  explicit TreeOfBodies(EquationsOfMotion& equations);

  void derivative(std::size_t stage, double t, const double* y, double* dydt);
  /// Projects by Newton steps with the factors of the last stage, as EquationsOfMotion does.
  bool project(double t, double* y);
  bool restart(double* y, double* dydt);

 private:
  using Vector3d = Eigen::Vector3d;
  using Direction = TreeNode::Direction;

  // ---- one evaluation
  void place(double t, const double* y);
  void place_joint(TreeNode* node);
  void place_directions(TreeNode* node) const;
  bool factor();
  void find_spins(const double* y);
  void accelerate(std::size_t stage, const double* y, double* dydt);
  Vector3d spin(std::size_t point) const;
  Vector3d inertia_times(std::size_t body, const Vector3d& w) const;
  SpatialVector relative_velocity(const TreeNode& node) const;
  SpatialVector held(const TreeNode& node, const double* of_rows) const;
  SpatialVector bias_of(const TreeNode& node, const SpatialVector& relative) const;
  void pull(TreeNode* node, const SpatialVector& relative, double* forces) const;
  void note_positions();
  void write_forces(const TreeNode& node, const SpatialVector& on_child, double* by_unknown) const;

  // ---- positions
  double find_values(double t, double* y);
  Vector3d ball_offset(std::size_t l) const;
  SpatialVector opening(const TreeNode& node) const;
  void correct(double* y);

  // ---- the linear system
  void reduce();
  template <class Act>
  void substitute(const Act& act);
  void find_forces(double* by_unknown);

  bool turns(std::size_t point) const { return point < bodies_; }
  JointVectors& vectors_of(const TreeNode& node) const {
    return view_.vectors[node.link - first_general_];
  }

  KernelView view_;
  BodyTree& tree_;
  List<TreeNode>& nodes_;
  std::size_t bodies_, first_general_;
  bool is_lost_ = false;  // whether a pivot was lost since the last restart
};

}  // namespace constraint_sim::engine
