#pragma once

#include <array>
#include <cstddef>

#include "engine/constraints/closing_errors.h"
#include "engine/constraints/joint.h"
#include "engine/constraints/moving_frame.h"
#include "engine/constraints/prescribed.h"
#include "engine/math/elementary.h"

namespace constraint_sim::engine {

// Motions that motors and closing prescribe, with their derivatives.

/// Sets the mean bias of a step, and returns the rate ζ that the motor prescribes throughout it.
MotorRate drive(const DistanceJoint& distance, const JointStep& step, const Motor& motor,
                JointState& state);
/// Sets the mean bias of a coordinate, and returns the rate ζ that its motor prescribes.
MotorRate drive(const CoordinateLaw& law, const JointStep& step, CoordinateState* state);

/// Prescribed motion of a joint over an interval without jumps: by its motors, and by an error that
/// is being closed.
class PrescribedMotion {
 public:
  PrescribedMotion() = default;
  PrescribedMotion(const Joint& joint, const JointStep& step, JointData& state) {
    begin(joint, step, state);
  }
  /// Begins the next interval. Sets bias (mean over the interval) and saturated of `state`.
  void begin(const Joint& joint, const JointStep& step, JointData& state);
  /// Makes a coordinate brake with `braking` [m/s² or rad/s²], < 0 from below, to rest at its held
  /// position at time `until` [s]. The caller ends this motion there, without which it turns back.
  void brake(int coordinate, double until, double braking) {
    Held& held = held_[static_cast<std::size_t>(coordinate)];
    held.until = until;
    held.braking = braking;
    is_driven_ = true;
  }

  bool is_driven() const { return is_driven_; }
  /// Whether the motors continue as in the previous interval.
  bool is_driven_as(const PrescribedMotion& before) const {
    for (std::size_t i = 0; i < count_; ++i) {
      const MotorRate &a = held_[i].motor, &b = before.held_[i].motor;
      if (a.bias != b.bias || a.amplitude != b.amplitude || a.frequency != b.frequency ||
          a.phase != b.phase || held_[i].until != before.held_[i].until ||
          held_[i].braking != before.held_[i].braking)
        return false;
    }
    return true;
  }
  bool is_closing() const { return closing_time_ > 0.0; }
  bool is_constant() const { return !is_driven() && !is_closing(); }
  /// Returns the prescribed length of a distance joint at simulated time t [s].
  Prescribed length(double t) const;
  /// Returns the prescribed errors at time t.
  ClosingErrors closing(double t) const { return closing(to_close_, t); }
  /// Returns the errors at time t where the joint had other errors to close.
  ClosingErrors closing(const ErrorsToClose& errors, double t) const {
    return is_closing() ? ClosingErrors(errors, rows_, t, closing_time_) : ClosingErrors();
  }
  /// Errors at the start of closing; zero where the joint does not close.
  const ErrorsToClose& to_close() const { return to_close_; }
  /// Whether the frame on B moves while the joint closes.
  bool moves_frame() const { return is_closing() && moves_frame_; }
  /// Returns the frame on B at time t, with its home `anchor_b`, `frame_b`.
  MovingFrame frame(double t, const Eigen::Vector3d& anchor_b,
                    const Eigen::Matrix3d& frame_b) const {
    return {anchor_b, frame_b, to_close_.shift, to_close_.turn, closing(t).share()};
  }
  /// Returns the prescribed error of a row, or the prescribed value of the form of a coordinate,
  /// for kinds other than kDistance.
  Prescribed target(int function, double t) const;
  /// Returns the rate that a motor prescribes for a function of the joint, or for the length,
  /// without the rate of closing; 0 for rows.
  double driven_rate(int function, double t) const {
    if (function < rows_) return 0.0;
    return moved(held_[static_cast<std::size_t>(function - rows_)], t).rate;
  }
  /// Returns the rate that the motor of a distance joint prescribes [m/s].
  double zeta(double t) const { return moved(held_[0], t).rate; }
  /// Visits all data for snapshots; see engine/support/memory.h.
  template <class Self, class Visit>
  static void visit_memory(Self& self, Visit& visit) {
    for (auto& held : self.held_) {
      visit.beside(held.value);
      visit.beside(held.motor);
      visit.beside(held.until);
      visit.beside(held.braking);
    }
    visit.beside(self.count_);
    visit.beside(self.rows_);
    visit.beside(self.is_driven_);
    for (auto* time : {&self.start_, &self.closing_time_}) visit.beside(*time);
    visit.beside(self.to_close_);
    visit.beside(self.moves_frame_);
    if constexpr (Visit::kReads) {
      for (auto& held : self.held_) held.phase = motor_phase(held.motor, self.start_);
    }
  }

 private:
  /// Prescribed motion of a motor: of the length of a distance joint, or of a coordinate.
  struct Held {
    double value = 0.0;  // value at the start, or at rest after braking
    MotorRate motor;
    double until = 0.0, braking = 0.0;  // end [s] and acceleration of braking; 0: no braking
    math::SineCosine phase;             // phase of the motor at start_
  };

  void hold(std::size_t i, double value, const MotorRate& motor);
  /// Returns the motion of the motor relative to `held.value`.
  Prescribed moved(const Held& held, double t) const {
    if (!is_driven_) return {};
    if (held.braking != 0.0) {
      const double left = held.until - t;
      return {0.5 * held.braking * left * left, -held.braking * left, held.braking};
    }
    return held.motor.is_moving() ? motor_motion(held.motor, held.phase, t - start_) : Prescribed{};
  }

  std::array<Held, kMaxCoordinates> held_;
  std::size_t count_ = 0;  // number of used entries of held_
  int rows_ = 0;           // number of rows, which precede the coordinates
  bool is_driven_ = false;
  double start_ = 0.0;  // start of the interval [s]
  double closing_time_ = 0.0;
  ErrorsToClose to_close_;
  bool moves_frame_ = false;
};

/// Adds the motion of the motors in an interval to travel and held positions.
void finish_interval(const Joint& joint, const JointStep& step, JointData& state);
/// Sets the rates of the motors to their means over a step whose parts were advanced one after the
/// other, each with its own mean. `before`: at the start of the step.
void set_mean_rates(const Joint& joint, const JointStep& step, const JointData& before,
                    JointData& state);

}  // namespace constraint_sim::engine
