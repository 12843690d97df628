#pragma once

#include "engine/dynamics/regularized_rows.h"
#include "engine/math/list.h"
#include "engine/methods/least_squares/island_bodies.h"
#include "engine/methods/least_squares/row_targets.h"

namespace constraint_sim::engine {

/// Positions of least Σ C²/a by Levenberg & Marquardt, with the weights 1/a of the start, a the
/// diagonal entry of G M⁻¹ Gᵀ. Springs resist as in a step, with a compliance per row.
class PoseFit {
 public:
  PoseFit(std::size_t rows, BodyVectors zeros);

  /// Moves the bodies of `configuration`, which has `geometry`. Returns the number of iterations.
  int fit(const IslandBodies& bodies, const RowTargets& targets, const List<double>& compliance,
          RegularizedRows* rows, Configuration* configuration, RegularizedRows::Geometry* geometry);

 private:
  void find_correction(double share, const List<double>& compliance, RegularizedRows* rows);

  List<double> weights_, values_, b_;
  BodyVectors change_;
};

}  // namespace constraint_sim::engine
