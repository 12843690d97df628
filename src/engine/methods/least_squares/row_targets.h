#pragma once

#include <Eigen/Core>
#include <array>
#include <cstddef>

#include "engine/dynamics/equations_of_motion.h"
#include "engine/dynamics/regularized_rows.h"
#include "engine/math/list.h"

namespace constraint_sim::engine {

/// Targets of the rows of an island at a time, set by prescribed motions, and errors of rows. All
/// numbers are per row, in the unit of the row.
class RowTargets {
 public:
  explicit RowTargets(const RegularizedRows& rows, BodyVectors zeros);

  /// Takes over lengths, offsets, rates of motors and immovable points at time t, and places the
  /// immovable points of `configuration`. Closing an error demands no rate: position corrections
  /// follow the target, and do work only on weights and springs.
  void set(double t, const RegularizedRows& rows, EquationsOfMotion* equations,
           Configuration* configuration);

  /// Length of a distance, component of a ball joint's offset, or rest length of a spring [m].
  double length(std::size_t row) const { return length_[row]; }
  /// Rate of the length [m/s].
  double rate(std::size_t row) const { return rate_[row]; }
  /// Velocities of immovable points, zero elsewhere.
  const BodyVectors& fixed() const { return fixed_; }
  /// Rate of the length that the bodies have to provide.
  double rate_of_bodies(const RegularizedRows& rows, std::size_t row) const {
    return rate_[row] - rows.apply(rows.rows()[row], fixed_);
  }
  /// Whether targets may change with time.
  bool is_driven() const { return is_driven_; }
  /// Largest coordinate or length [m].
  double scale() const { return scale_; }

  /// Computes C of rigid rows [m], and 0 for springs. Returns Σ C²/weight.
  double errors(const RegularizedRows& rows, const RegularizedRows::Geometry& geometry,
                const List<double>& weights, List<double>* values) const;
  /// Length of a spring, or position of the coordinate of a spring [m].
  double extent(const RegularizedRows& rows, std::size_t row,
                const RegularizedRows::Geometry& geometry) const;
  /// Tells `equations` the positions of the coordinates of springs and couplings.
  void write_positions(const RegularizedRows& rows, const RegularizedRows::Geometry& geometry,
                       EquationsOfMotion* equations);

 private:
  void set_joint(double t, std::size_t joint, const RegularizedRows& rows,
                 EquationsOfMotion* equations, const Configuration& configuration);
  void read_positions(const CoordinatePositions& coordinates);
  Eigen::Vector3d components(std::size_t first_row) const;
  double share_off(std::size_t first_row, const Eigen::Vector3d& d) const;
  double reading(std::size_t coupled, std::size_t term,
                 const RegularizedRows::Geometry& geometry) const;
  double general_error(const RegularizedRows& rows, std::size_t row,
                       const RegularizedRows::Geometry& geometry) const;

  List<double> length_, rate_;
  BodyVectors fixed_;
  bool is_driven_ = false;
  double scale_ = 1.0;
  // Coordinates of springs and couplings, and the positions from which their angles are unwound.
  List<EquationsOfMotion::SoftCoordinate> softs_;
  List<EquationsOfMotion::CoupledRow> coupled_;
  List<double> soft_positions_;                 // per soft coordinate
  List<std::array<double, 2>> term_positions_;  // per coupled row
};

/// Largest magnitude of a list, or NaN.
double largest_of(const List<double>& list);

}  // namespace constraint_sim::engine
