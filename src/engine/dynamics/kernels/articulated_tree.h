#pragma once

#include <Eigen/Core>
#include <cstddef>

#include "engine/dynamics/equations_of_motion.h"
#include "engine/dynamics/kernels/joint_tree.h"
#include "engine/dynamics/kernels/tree_closings.h"
#include "engine/dynamics/kernels/tree_dynamics.h"
#include "engine/dynamics/kernels/tree_momentum.h"
#include "engine/math/integrate.h"
#include "engine/math/list.h"

namespace constraint_sim::engine {

/// State of an island in joint coordinates: the state of JointTree with the memory of Runge-Kutta
/// steps. From interval to interval, bodies follow from it and not the other way round, so that
/// joints of the tree are met to rounding without projections.
class ArticulatedTree {
 public:
  explicit ArticulatedTree(EquationsOfMotion& equations);

  /// Whether the interval that begin() of the equations has set can be integrated in joint
  /// coordinates: no joint is being closed, and no row of a loop is momentary.
  bool can_advance(const EquationsOfMotion& equations) const;
  /// Whether the coordinates are those of the bodies.
  bool is_current() const { return is_current_; }
  void forget() { is_current_ = false; }
  /// Resets to the state after construction.
  void restart() { is_current_ = is_ill_conditioned_ = is_by_rows_in_step_ = false; }
  /// Begins a step, in which loops may have left a singular pose.
  void begin_step() { is_by_rows_in_step_ = false; }

  /// Accelerations of the bodies where the dynamics were evaluated.
  void find_accelerations(Motions* rates) const;
  StageMemory memory() { return {numbers_.data(), tree_.size}; }
  const JointTree& tree() const { return tree_; }
  TreeDynamics& dynamics() { return dynamics_; }
  List<double>& work() { return work_; }
  List<TreeRoot>& roots() { return roots_; }
  List<double>& noted() { return noted_; }
  TreeMomentum& momentum() { return momentum_; }
  TreeClosings& closings() { return closings_; }
  void set_current() { is_current_ = true; }
  /// Whether the dynamics were evaluated at the state in this interval.
  bool is_placed() const { return is_placed_; }
  void set_placed(bool is_placed) { is_placed_ = is_placed; }
  /// Largest coordinate relative to the root at the start of the next substep [m].
  double size() const { return size_; }
  void set_size(double size) { size_ = size; }
  void note_size();
  /// Whether the equations with all rows advance the island in place of the tree: for good once a
  /// pivot of H was lost, or for the rest of a step in which a loop passes a singular pose.
  bool is_left_to_rows() const { return is_ill_conditioned_ || is_by_rows_in_step_; }
  void set_ill_conditioned() {
    is_ill_conditioned_ = true;
    is_current_ = false;
  }
  void leave_step_to_rows() {
    is_by_rows_in_step_ = true;
    is_current_ = false;
  }
  /// Leaves loops to the rows that no step in joint coordinates can close.
  void note_failure(const IntegrationResult& progress) {
    if (progress.is_inconsistent && !closings_.empty()) leave_step_to_rows();
  }

  /// Visits all state that the next interval continues from, as engine/support/memory.h describes.
  /// `has_started`: whether there is a next interval that does.
  template <class Self, class Visit>
  static void visit_memory(Self& self, Visit& visit, bool has_started) {
    visit(self.is_ill_conditioned_);
    if (!has_started) return;
    visit(self.is_current_);
    if constexpr (Visit::kReads) self.is_placed_ = false;
    if (!self.is_current_) return;
    visit(self.size_);
    visit(self.momentum_.centre);
    visit(self.momentum_.linear);
    visit(self.momentum_.angular);
    const std::size_t n = self.tree_.size;
    for (std::size_t i = 0; i < n; ++i) visit(self.numbers_[i]);
    for (std::size_t i = 0; i < n; ++i) visit(self.numbers_[StageMemory::kDerivatives * n + i]);
  }

 private:
  JointTree tree_;
  TreeDynamics dynamics_;
  TreeClosings closings_;
  List<double> numbers_;   // storage of StageMemory
  List<double> work_;      // a state with prescribed coordinates; changes of all motions
  List<TreeRoot> roots_;   // per body, of its tree
  TreeMomentum momentum_;  // momenta of a free tree at the start of the next substep
  List<double> noted_;     // positions of the motions when the interval began
  bool is_current_ = false;
  bool is_placed_ = false;
  double size_ = 0.0;
  bool is_ill_conditioned_ = false;
  bool is_by_rows_in_step_ = false;  // false between steps
};

}  // namespace constraint_sim::engine
