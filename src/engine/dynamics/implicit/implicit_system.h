#pragma once

#include <Eigen/Core>
#include <cstddef>

#include "engine/dynamics/implicit/implicit_model.h"
#include "engine/dynamics/implicit/implicit_time.h"
#include "engine/math/larger.h"
#include "engine/math/list.h"
#include "engine/math/saddle_lu.h"

namespace constraint_sim::engine {

/// Scaled equations of a step: residual and derivative, which bodies and links add to. Scaling:
/// bodies by √m, rows to unit norm.
class ImplicitSystem {
 public:
  using Vector = Eigen::Map<Eigen::Vector3d>;

  /// Adds to entries of the derivative, in the order in which find_slots() lists them.
  class Entries {
   public:
    Entries(double* values, const SaddleLu::Slot* slot) : values_(values), slot_(slot) {}
    void add(double value) { values_[*slot_++] += value; }
    void skip(int count) { slot_ += count; }

   private:
    double* values_;
    const SaddleLu::Slot* slot_;
  };

  explicit ImplicitSystem(const ImplicitModel& model);

  std::size_t size() const { return left_.size(); }
  /// Makes the next solution depend on its matrix alone, to the last bit.
  void forget() { lu_.forget(); }

  // ---- start of a step
  /// Sets the factor of forces, and the scales of the bodies.
  void begin(const ImplicitModel& model, const ImplicitTime& time);
  /// Sets the scale of a row.
  void scale_row(int unknown, double scale) {
    left_[unknown] = scale;
    right_[unknown] = scale / s_;
  }

  // ---- evaluation
  /// Sets the derivative and the errors of rows to zero.
  void clear();
  Entries entries_of_bodies() { return {lu_.values().data(), diagonal_.data()}; }
  Entries entries_of_link(std::size_t l) {
    return {lu_.values().data(), slots_.data() + first_slot_[l]};
  }
  Entries entries_of_coupling(std::size_t c) {
    return {lu_.values().data(), slots_.data() + first_coupled_slot_[c]};
  }
  /// Scales of the equations, and of the unknowns, from `unknown` on.
  const double* left(int unknown) const { return left_.data() + unknown; }
  const double* right(int unknown) const { return right_.data() + unknown; }
  /// Scale of the derivative of an equation by its own unknown.
  double scale_of(std::size_t unknown) const { return left_[unknown] * right_[unknown]; }
  /// Residual of three equations of a body, not scaled.
  Vector residual_at(std::size_t unknown) { return Vector(residual_.data() + unknown); }
  void set_residual(int unknown, double value) { residual_[unknown] = value; }
  void set_torque(std::size_t body, const Eigen::Vector3d& torque) { torque_[body] = torque; }
  void add_torque(std::size_t body, const Eigen::Vector3d& torque) { torque_[body] += torque; }
  /// Notes the error of a row that is not redundant [m].
  void note_row(double error, bool is_left_out) {
    double& worst = is_left_out ? worst_momentary_row_ : worst_row_;
    worst = larger(worst, error);
  }
  /// Adds the derivative of ½ŵ T, which needs the total torques, and scales the residual.
  void finish(const ImplicitModel& model);

  // ---- results of an evaluation
  const List<double>& residual() const { return residual_; }
  /// Replaces b by the inverse of the derivative times b. Returns false where the derivative is
  /// singular. Called once after each evaluation.
  bool solve(double* b) { return lu_.solve(b); }
  /// Adds a scaled change to the unknowns. Returns the largest displacement of a point [m].
  double add(const ImplicitModel& model, const double* change, List<double>* unknowns) const;
  /// Largest error of a row [m].
  double worst_row() const { return worst_row_; }
  /// Largest error of a momentary row [m]. Momentary rows depend on other rows at the start of the
  /// step and have no force in it.
  double worst_momentary_row() const { return worst_momentary_row_; }

 private:
  void find_slots(const ImplicitModel& model);

  SaddleLu lu_;
  // Entries of links and couplings, and the first entry of each; entries of blocks of bodies.
  List<SaddleLu::Slot> slots_, diagonal_;
  List<std::size_t> first_slot_, first_coupled_slot_;
  double s_ = 0.0;
  List<double> left_, right_;  // scales of equations and unknowns
  List<double> residual_;
  List<Eigen::Vector3d> torque_;  // total torque per rotating body [N m]
  double worst_row_ = 0.0, worst_momentary_row_ = 0.0;
};

}  // namespace constraint_sim::engine
