#pragma once

#include "engine/math/list.h"
#include "engine/methods/sequential_impulses/sequential_impulses.h"
#include "engine/model/model.h"
#include "engine/model/state.h"

namespace constraint_sim::engine {

/// Error estimate of a part of a step of impulses that is taken whole and in two halves. It is the
/// larger one of two estimates, for the body where it is largest; rotations count times radius of
/// gyration.
///
/// The first is the distance of both results. It is blind to an impact that both treat alike. The
/// second needs no other result. With h the length of a half and Δ₁ and Δ₂ the changes of velocity
/// by impulses in both, it is ½ h ‖Δ₂ − Δ₁‖, which both results differ by if they end with one
/// velocity, and h times the velocity by which each half moved the body off the mean of its
/// velocities.
class PartError {
 public:
  /// Takes the result of the whole part.
  void begin(const List<int>& bodies, const State& state);
  /// Takes the start of a half, and its end after `h` [s].
  void begin_half(const List<int>& bodies, const State& state);
  void end_half(const Model& model, double h, const List<int>& bodies, const State& state,
                const SequentialImpulses& method);
  /// Largest error of a body after both halves [m].
  double largest(const Model& model, const List<int>& bodies, const State& state) const;

  /// Bound of the error of a part of `h` [s] in which hardly anything moves [m]: twice the
  /// displacement of the fastest body.
  static double bound_where_slow(const Model& model, double h, const List<int>& bodies,
                                 const List<BodyState>& starts, const State& state);

 private:
  bool is_second_ = false;   // half
  List<BodyState> whole_;    // bodies after the whole part
  List<BodyState> starts_;   // bodies before the half
  List<Twist> changes_;      // changes of velocities in the first half
  List<double> by_changes_;  // second estimate [m]
};

}  // namespace constraint_sim::engine
