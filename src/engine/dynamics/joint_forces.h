#pragma once

#include <cstddef>

#include "engine/constraints/joint.h"
#include "engine/dynamics/interval_inputs.h"
#include "engine/dynamics/island_model.h"
#include "engine/dynamics/kinematics.h"
#include "engine/math/integrate.h"
#include "engine/math/list.h"

namespace constraint_sim::engine {

/// Forces of the joints of an island in all stages of a substep, and their impulses since the
/// start of the step. Lists are by unknown: rows in the order of the Delassus matrix, then springs,
/// then soft coordinates.
class JointForces {
 public:
  explicit JointForces(const IslandModel& island);

  /// Sorts all lists for another order of the rows; `unknown`: index of the unknown of each row.
  void sort(const List<std::size_t>& unknown);
  std::size_t unknowns() const { return impulses_.size(); }
  std::size_t of_soft(const IslandModel& island, std::size_t soft) const {
    return of_spring(island, island.links().size()) + soft;
  }
  /// Forces in a stage and impulses, by unknown.
  double* stage(std::size_t stage) { return stage_forces_.data() + stage * unknowns(); }
  double* impulses() { return impulses_.data(); }

  void begin_step() { std::fill(impulses_.begin(), impulses_.end(), 0.0); }
  /// Adds the impulses of a substep of length h [s] by the weights of a Runge-Kutta pair.
  template <class Pair>
  void accept(double h) {
    using Weights = runge_kutta::StageWeights<Pair, Pair::kStages>;
    const std::size_t n = impulses_.size();
    for (std::size_t i = 0; i < n; ++i)
      impulses_[i] += h * runge_kutta::sum<Weights>(stage_forces_.data() + i, n);
  }
  /// Adds an impulse of the rigid rows of joint l [N s or N m s].
  void add(const IslandModel& island, std::size_t l, const RowVector& impulse);
  void add_coupled(const IslandModel& island, std::size_t coupled, double impulse) {
    impulses_[unknown_[island.coupled_rows()[coupled].row]] += impulse;
  }
  void add_soft(const IslandModel& island, std::size_t soft, double impulse) {
    impulses_[of_soft(island, soft)] += impulse;
  }
  /// Saves impulses, or impulses and the forces of the first stage.
  void keep() { kept_impulses_ = impulses_; }
  void keep_first_stage();
  void restore() { impulses_ = kept_impulses_; }
  void restore_first_stage();

  /// Impulse of joints()[l], laid out as read_integrated_joint() expects.
  RowVector impulse(const IslandModel& island, std::size_t l) const {
    return by_joint(island, l, impulses_.data());
  }
  /// Impulse of the rigid rows of joints()[l].
  RowVector row_impulse(const IslandModel& island, std::size_t l) const {
    return of_rows(island, l, impulses_.data());
  }
  /// Impulse of the coupling of joints()[l]; 0 where joint l does not couple.
  double coupled_impulse(const IslandModel& island, std::size_t l) const {
    return coupled(island, l, impulses_.data());
  }
  /// Impulse of joint l in the order of rows and coordinates of its kind; `of_rows`: impulses of
  /// its rigid rows.
  RowVector by_function(const IslandModel& island, std::size_t l, const RowVector& of_rows) const {
    return by_function(island, l, of_rows, impulses_.data());
  }
  /// Force of joint l in a stage of the last substep, laid out as impulse() [N or N m]; of a gear
  /// or pulley the force along its first coordinate comes first.
  RowVector force(const IslandModel& island, std::size_t l, std::size_t stage) const;
  /// Force of the coupling of joints()[l] in the first stage; 0 where joint l does not couple.
  double coupled_force(const IslandModel& island, std::size_t l) const {
    return coupled(island, l, stage_forces_.data());
  }
  /// Largest force of the last first stage [N or N m].
  double largest() const;
  /// Largest frequency ω of the bodies under the forces of the last first stage [rad/s]: ω² =
  /// 2Σ|λ|/m for rods, Σ‖f‖‖r‖/I_min for a rotating body. `scale`: size of the island [m].
  double frequency(const IslandModel& island, const IntervalInputs& inputs,
                   const Kinematics& kinematics, double scale);

  /// Visits the forces of the first stage, as engine/support/memory.h describes.
  template <class Self, class Visit>
  static void visit_first_stage(Self& self, Visit& visit) {
    for (std::size_t i = 0; i < self.impulses_.size(); ++i) visit(self.stage_forces_[i]);
  }

 private:
  std::size_t of_spring(const IslandModel& island, std::size_t l) const {
    return unknown_.size() + l - island.first().spring;
  }
  std::size_t of_single(const IslandModel& island, std::size_t l) const {
    return island.is_rod(l) ? unknown_[l] : of_spring(island, l);
  }
  double coupled(const IslandModel& island, std::size_t l, const double* of_unknowns) const;
  RowVector of_rows(const IslandModel& island, std::size_t l, const double* of_unknowns) const;
  RowVector by_function(const IslandModel& island, std::size_t l, const RowVector& of_rows,
                        const double* of_unknowns) const;
  RowVector by_joint(const IslandModel& island, std::size_t l, const double* of_unknowns) const;
  template <class OfRow>
  RowVector sorted(const IslandModel& island, std::size_t l, const OfRow& of_row,
                   const double* of_unknowns) const;

  List<std::size_t> unknown_;  // per row
  List<double> stage_forces_;  // by stage, then by unknown
  List<double> impulses_;      // stage_forces_ integrated over time
  List<double> kept_impulses_, kept_forces_;
  List<double> squares_;  // ω² per body, for frequency()
};

}  // namespace constraint_sim::engine
