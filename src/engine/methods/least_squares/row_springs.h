#pragma once

#include <algorithm>

#include "engine/dynamics/equations_of_motion.h"
#include "engine/dynamics/regularized_rows.h"
#include "engine/math/list.h"
#include "engine/methods/least_squares/row_targets.h"

namespace constraint_sim::engine {

/// Laws of the springs, dampers and constant forces of an island, by row: with the stretch x,
/// force F − K x − C ẋ.
class RowSprings {
 public:
  RowSprings(const EquationsOfMotion& equations, const RegularizedRows& rows);

  double stiffness(std::size_t row) const { return stiffness_[row]; }
  double damping(std::size_t row) const { return damping_[row]; }
  double force(std::size_t row, double stretch, double rate) const {
    return force_[row] - stiffness_[row] * stretch - damping_[row] * rate;
  }
  /// Inverse of `given`, the mass by which the law resists an impulse over the step [kg], or of its
  /// lower bound for constant forces.
  double compliance(std::size_t row, double given) const {
    return 1.0 / std::max(given, least_given_[row]);
  }
  /// Energy of springs [J]; energy of constant forces counts from the rest position.
  double energy(const RegularizedRows& rows, const RowTargets& targets,
                const RegularizedRows::Geometry& geometry) const;
  /// Energy that dampers dissipate in a step of length h [s] between two geometries [J].
  double damped_energy(const RegularizedRows& rows, const RowTargets& targets, double h,
                       const RegularizedRows::Geometry& start,
                       const RegularizedRows::Geometry& end) const;

 private:
  List<double> stiffness_, damping_, force_;
  List<double> least_given_;  // lower bound for constant forces [kg]
};

}  // namespace constraint_sim::engine
