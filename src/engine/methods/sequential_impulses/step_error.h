#pragma once

#include <Eigen/Core>
#include <cstddef>

#include "engine/impulses/row_solver.h"
#include "engine/math/list.h"
#include "engine/model/mass_properties.h"
#include "engine/model/state.h"

namespace constraint_sim::engine {

/// Error estimate of a step of impulses that is taken once, from the velocities of the step. With h
/// the length of the step, Δ the change of velocity of a body, and δ the part of Δ by which the
/// impulses differ from the impulses of the step before, it is the sum of
///   h ‖off‖          with off the velocity by which the body moved off the mean of its velocities;
///                    rotations move by the last one, so theirs is ½ Δ
///   ½ h ‖δ‖          the change of forces, which act from the start of the step or later
///   h² ‖ω‖ ‖Δ_g‖     with Δ_g the change of angular velocity ω at constant angular momentum
///   h ‖w‖            with w the velocity that corrects errors of steps before and the curvature
///                    of joints.
/// Rotations count times radius of gyration. Bodies that rows connect share the largest sum. The
/// first three are together at most twice the displacement of their fastest body.
class StepError {
 public:
  /// Begins a step of a world with so many bodies.
  void begin_step(std::size_t bodies) { errors_.assign(bodies, 0.0); }
  /// Takes the impulses of the step before from the rows, which start from them.
  void note_guesses(const List<Row>& rows);
  /// Takes the momenta by which the impulses of `rows` differ from the noted ones.
  void note_impulses(const List<Row>& rows);
  /// Estimates the error of a body in `h` [s], after note_impulses(). `state`: before the motion;
  /// `off_mean`: velocity by which the centre moves off the mean of its velocities [m/s].
  void measure(std::size_t body, double h, const MassProperties& mass, const BodyState& state,
               const Eigen::Vector3d& off_mean, const RowSolver& solver);
  /// Adds the errors to the sums of the step, after measure() of all bodies. `has_rows`: whether
  /// `solver` has components.
  void add(const List<int>& bodies, bool has_rows, RowSolver* solver);
  /// Adds an error to a body [m]; NaN where the step has no estimate.
  void add(std::size_t body, double error) { errors_[body] += error; }
  /// Error of a body in this step [m].
  double of(std::size_t body) const { return errors_[body]; }

 private:
  /// Errors of a body in one part of the step, and the bound of `by_motion` [m].
  struct Parts {
    double by_motion = 0.0, by_correction = 0.0, bound = 0.0;

    void take_larger(const Parts& other);
    double sum() const;
  };

  List<double> guesses_;  // by row [N s]
  List<Twist> momenta_;   // by body, linear above angular [N s, N m s]
  List<Parts> parts_;     // by body
  List<double> errors_;   // by body, sums of the step [m]
};

}  // namespace constraint_sim::engine
