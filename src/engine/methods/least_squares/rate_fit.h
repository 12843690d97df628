#pragma once

#include "engine/dynamics/regularized_rows.h"
#include "engine/math/list.h"
#include "engine/methods/least_squares/row_targets.h"

namespace constraint_sim::engine {

/// Velocities that meet the rates of rows by least squares.
class RateFit {
 public:
  RateFit(std::size_t rows, BodyVectors zeros);

  /// Projects `velocity` onto the target rates at a configuration with `geometry`, and adds the
  /// impulses of rows to `impulses` [N s]. Returns the work of driven joints [J].
  double fit(const RowTargets& targets, const Configuration& configuration,
             const RegularizedRows::Geometry& geometry, RegularizedRows* rows,
             BodyVectors* velocity, List<double>* impulses);

  // ---- results of the last fit
  /// Velocity of least kinetic energy that meets the rates as far as possible, and its rates.
  const BodyVectors& drive() const { return drive_; }
  const List<double>& drive_rates() const { return drive_rates_; }
  /// Whether all rows and their rates can be met, with the errors `values` of rows and the
  /// velocities of the fit.
  bool can_be_met(const RowTargets& targets, const List<double>& values, double largest_speed,
                  const BodyVectors& velocity, RegularizedRows* rows);
  /// Diagonal entries of G M⁻¹ Gᵀ at the configuration.
  const List<double>& weights() const { return weights_; }

 private:
  void find_drive(const RowTargets& targets, RegularizedRows* rows);
  void solve_drive(double share, const List<double>& rates, RegularizedRows* rows);

  List<double> weights_, b_, drive_rates_;
  BodyVectors drive_;
};

}  // namespace constraint_sim::engine
