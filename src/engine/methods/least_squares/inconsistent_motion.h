#pragma once

#include <Eigen/Core>
#include <cstddef>

#include "constraint_sim/engine/body.h"
#include "engine/dynamics/equations_of_motion.h"
#include "engine/dynamics/method.h"
#include "engine/dynamics/regularized_rows.h"
#include "engine/math/integrate.h"
#include "engine/math/list.h"
#include "engine/methods/least_squares/island_bodies.h"
#include "engine/methods/least_squares/pose_fit.h"
#include "engine/methods/least_squares/rate_fit.h"
#include "engine/methods/least_squares/row_springs.h"
#include "engine/methods/least_squares/row_targets.h"

namespace constraint_sim::engine {

/// Motion of an island whose rigid rows cannot all be met: positions of least Σ C²/a, a the
/// diagonal entry of G M⁻¹ Gᵀ, and velocities that meet the rates of motors by least squares. Each
/// step:
///   1. midpoint rule with the discrete gradients of ImplicitStep and impulses along Ḡ that lead
///      to the result of 2; conserves energy and both momenta
///   2. PoseFit from there, which moves positions only: rates of rows near
///      contradiction have no bound
///   3. RateFit, a projection of velocities onto the rates, which only removes energy
/// Where the impulses of 1 are not found, or add energy, 2 makes the whole correction.
class InconsistentMotion {
 public:
  // Defined in the .cpp file: copies of so many fields are compiled once.
  InconsistentMotion(const InconsistentMotion& other);
  InconsistentMotion(InconsistentMotion&& other) noexcept;
  InconsistentMotion& operator=(const InconsistentMotion& other);
  InconsistentMotion& operator=(InconsistentMotion&& other) noexcept;
  ~InconsistentMotion();

  explicit InconsistentMotion(const EquationsOfMotion& equations);

  /// Advances the island as IslandMethod describes, whatever the options: errors of unmet rows are
  /// larger than a tolerance.
  IntegrationResult advance(const Interval& interval, const IntegratorOptions& options,
                            EquationsOfMotion* equations, List<BodyState>* states);
  /// Every interval begins from the bodies alone.
  bool has_started() const { return false; }
  void forget() {}
  void restart() { can_be_met_ = false; }
  /// Whether all rows and their rates could be met at the end of the last interval.
  bool can_be_met() const { return can_be_met_; }

 private:
  using Rows = RegularizedRows::Geometry;
  using Numbers = List<double>;  // one per row

  int number_of_parts(const EquationsOfMotion& equations, double h) const;
  void step(const EquationsOfMotion& equations, double h, double energy_before,
            IntegrationResult* progress);

  // ---- step by the midpoint rule
  bool midpoint(const EquationsOfMotion& equations, double h, IntegrationResult* progress);
  double find_missing(double h);
  void drift(const EquationsOfMotion& equations, double h);

  // ---- step without impulses that lead to met rows
  void explicit_step(const EquationsOfMotion& equations, double h, IntegrationResult* progress);
  void find_explicit_impulses(double h);
  void stop_against_correction();
  void restore_angular_momentum(const EquationsOfMotion& equations, double h);

  // ---- energy at the end of a step
  double kinetic_energy() const { return bodies_.kinetic_energy(end_, velocity_); }
  double allowed_energy(const EquationsOfMotion& equations, double energy_before) const;
  double most_added(const EquationsOfMotion& equations, double h) const;
  double hold_back(const EquationsOfMotion& equations, double energy_before, double allowed);
  double work_of_drives() const;
  void cap_energy(double allowed, IntegrationResult* progress);

  IslandBodies bodies_;
  RegularizedRows rows_;
  RowTargets targets_;
  RowSprings springs_;
  PoseFit pose_fit_;
  RateFit rate_fit_;

  // Start and end of a step, and positions of least error from its end by drift().
  Configuration start_, end_, met_;
  Rows at_start_, at_end_, at_met_;
  BodyVectors velocity_, velocity_before_;
  BodyVectors displacement_;  // displacement by drift() from the start of the step
  BodyVectors change_;        // scratch

  Numbers weights_, values_, b_, compliance_;
  Numbers step_impulses_;       // impulses of all rows in one step [N s]
  Numbers lambda_;              // impulses that moved the bodies in one step [N s]
  Numbers impulses_;            // sum of step_impulses_ since the start of the interval
  Numbers q_;                   // ½h times the impulses of a midpoint step
  Numbers drive_before_;        // rates of driven rows at the start of the step
  double work_ = 0.0;           // work of driven joints in one step [J]
  double spring_energy_ = 0.0;  // energy of springs at end_ [J]
  bool can_be_met_ = false;
};

}  // namespace constraint_sim::engine
