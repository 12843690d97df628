#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <cstddef>

#include "engine/dynamics/delassus_matrix.h"
#include "engine/dynamics/interval_inputs.h"
#include "engine/dynamics/island_model.h"
#include "engine/dynamics/joint_forces.h"
#include "engine/dynamics/kinematics.h"
#include "engine/math/list.h"

namespace constraint_sim::engine {

/// Rows of an island at an evaluated pose.
struct PlacedRows {
  const IslandModel& island;
  const IntervalInputs& inputs;
  const Kinematics& kinematics;
  double scale;  ///< size of the island [m]
  double time;   ///< time of the last projection [s]
};

/// Rows without a force. A redundant row follows from the kept rows at all reachable poses: it has
/// no force and holds because the kept rows do. A momentary row depends on others only in a
/// singular pose that the motion passes, and is left out of the factors there.
/// Both have a self-stress n: forces of the rows, 1 on the row itself, that balance at every body,
/// Gᵀn = 0. Rows are chosen by pivots (Jacobian in the metric M⁻¹), verified by their self-stress
/// and watched as the bodies move. Masses do not enter the self-stress, so a pivot that is small by
/// a mass ratio is not taken for dependence.
class RedundantRows {
 public:
  explicit RedundantRows(const IslandModel& island);

  const List<char>& is_redundant() const { return is_redundant_; }
  /// Lets no choice take a row of a link for redundant. Joints of one tree are independent.
  void require(const IslandModel& island, std::size_t link);
  /// Whether the error of a redundant row [m] is within its tolerance.
  bool is_within_tolerance(std::size_t row, double error) const { return error <= tolerance_[row]; }
  /// Whether redundant rows were chosen.
  bool has_chosen() const { return has_chosen_; }
  /// Lets the next start() choose again.
  void ask_for_choice() { has_chosen_ = false; }
  /// Whether the last start or step found joints that contradict each other.
  bool is_inconsistent() const { return is_inconsistent_; }
  void set_inconsistent(bool is) { is_inconsistent_ = is; }
  /// Whether rows that were left out got a force again since the last substep.
  bool came_back() const { return came_back_; }
  void set_came_back(bool is) { came_back_ = is; }
  /// Whether the motion passes a pose with momentary rows.
  bool is_passing() const { return left_out_for_ > 0 || came_back_; }
  /// Whether the last restart had momentary rows.
  bool was_passing() const { return left_out_for_ > 0; }
  /// Error of momentary rows since begin_step(), Σ rate × substep [m].
  double momentary_error() const { return momentary_error_; }
  void begin_step() { momentary_error_ = 0.0; }

  /// Discards the choice, as in rows that were just compiled.
  void forget(const IslandModel& island, DelassusMatrix* delassus, JointForces* forces);
  /// Sets the redundant rows. Compiles the matrix and sorts the forces where the rows change.
  void set(const IslandModel& island, const List<char>& redundant, DelassusMatrix* delassus,
           JointForces* forces);
  /// Finds the redundant rows at this pose. Returns the number of rows that depend on others and
  /// are not redundant.
  int choose(const PlacedRows& rows, DelassusMatrix* delassus, JointForces* forces);
  /// Whether the kept rows have come near dependence since the choice.
  bool is_choice_due(const PlacedRows& rows, const DelassusMatrix& delassus) const;
  /// Forgets steps that were rejected since kept rows were near dependence.
  void end_rejections() { rejections_ = 0; }

  /// Starts to collect the errors of redundant rows.
  void begin_errors() { worst_ = 0.0; }
  /// Takes the error of a row [m] into account if the row is redundant; else returns false.
  bool take_error(std::size_t row, double error) {
    if (!is_redundant_[row]) return false;
    worst_ = std::max(worst_, error / tolerance_[row]);
    return true;
  }
  /// Sets the tolerances of redundant rows, where all errors are known and the kept rows are met.
  /// Returns false where a redundant row contradicts the others.
  bool limit(const PlacedRows& rows, const DelassusMatrix& delassus);
  /// Whether the error of any redundant row exceeds its tolerance.
  bool are_off(const PlacedRows& rows, const DelassusMatrix& delassus) const;
  /// Gives redundant rows that exceed their tolerance a force again; while joints are being closed
  /// the joints are inconsistent instead. Returns whether any row exceeds it. Where the kept rows
  /// came near dependence within one step, the step is first repeated with shorter ones.
  bool restore_if_off(const PlacedRows& rows, DelassusMatrix* delassus, JointForces* forces);
  /// Whether the rates of redundant rows are conclusive.
  bool are_rates_known(const DelassusMatrix& delassus) const;
  /// Checks the rates of redundant rows after a projection of velocities. Where a rate is off,
  /// returns false and gives the row a force; under prescribed motions the joints are inconsistent
  /// instead.
  bool rates_are_met(const PlacedRows& rows, DelassusMatrix* delassus, JointForces* forces);

  /// Keeps rows that factors left out although their self-stress does not balance: their pivots are
  /// small because of a mass ratio. Factors again with `least`.
  void verify_left_out(const PlacedRows& rows, double least, DelassusMatrix* delassus);
  /// Adds the error of momentary rows over a substep [s], by their rates. Rows that stay momentary
  /// may be redundant, so the next start chooses again after some restarts.
  void note_left_out(const PlacedRows& rows, const DelassusMatrix& delassus, double substep);
  void note_none_left_out() { left_out_for_ = 0; }

  template <class Self, class Visit>
  static void visit_redundant(Self& self, Visit& visit) {
    for (auto* rows : {&self.is_needed_, &self.is_verified_}) visit(*rows);
    for (auto* rows : {&self.imbalance_, &self.tolerance_}) visit(*rows);
  }
  template <class Self, class Visit>
  static void visit_choice(Self& self, Visit& visit) {
    visit(self.pivot_at_choice_);
    for (auto* number : {&self.rejections_, &self.left_out_for_, &self.choose_after_})
      visit(*number);
  }
  template <class Self, class Visit>
  static void visit_inconsistent(Self& self, Visit& visit) {
    visit(self.is_inconsistent_);
  }
  template <class Self, class Visit>
  static void visit_has_chosen(Self& self, Visit& visit) {
    visit(self.has_chosen_);
  }

 private:
  void find_branches(const IslandModel& island);
  List<char> independent_rows(const PlacedRows& rows, double least, DelassusMatrix* delassus);
  Eigen::MatrixXd dense_matrix(const PlacedRows& rows, DelassusMatrix* delassus);
  double self_stress_imbalance(const PlacedRows& rows, std::size_t row, DelassusMatrix* delassus);
  double redundant_self_stress() const;
  void make_rows_again(const IslandModel& island, const List<char>& redundant,
                       DelassusMatrix* delassus, JointForces* forces);
  List<char> met_rows(const PlacedRows& rows, const DelassusMatrix& delassus) const;
  double tolerance(const PlacedRows& rows, std::size_t row, const DelassusMatrix& delassus) const;

  List<char> is_redundant_;       // per row
  List<char> is_required_;        // per row: is never redundant
  List<char> is_needed_;          // per row: was redundant once, by mistake
  List<char> is_verified_;        // per row: left out, and its self-stress is balanced
  List<double> imbalance_;        // per row: imbalance of its self-stress when chosen as redundant
  List<double> tolerance_;        // per row: tolerance of a redundant row [m]
  double worst_ = 0.0;            // largest error over tolerance since begin_errors()
  double pivot_at_choice_ = 1.0;  // smallest pivot of the kept rows when chosen
  int rejections_ = 0;            // consecutive steps rejected, as kept rows are near dependence
  int left_out_for_ = 0;          // consecutive restarts with momentary rows
  int choose_after_ = 0;          // restarts with momentary rows before the next choice
  bool has_chosen_ = false;
  bool is_inconsistent_ = false;
  bool came_back_ = false;
  double momentary_error_ = 0.0;    // [m]
  List<double> stress_, residual_;  // by unknown
};

}  // namespace constraint_sim::engine
