#pragma once

#include "constraint_sim/engine/joint.h"
#include "constraint_sim/engine/world.h"
#include "engine/constraints/anchor_pair.h"
#include "engine/constraints/closing_errors.h"
#include "engine/constraints/course.h"
#include "engine/constraints/law.h"
#include "engine/constraints/moving_frame.h"
#include "engine/constraints/row.h"
#include "engine/math/list.h"
#include "engine/model/joint_data.h"

namespace constraint_sim::engine {

/// Marks a row of the coupling, in place of the number of a coordinate.
inline constexpr int kOfCoupling = -2;

/// Time, length and settings of a step.
struct JointStep {
  double t;             ///< simulated time at the start [s]
  double h;             ///< length [s]
  double beta;          ///< Baumgarte's share for joints without a share of their own
  double closing_time;  ///< time in which an error left by an edit is closed [s]; 0: by Baumgarte
  /// Coordinates at the end of the step, from a method that counts turns within it. NaN or nullptr
  /// where turns were not counted.
  const double* counted = nullptr;
  /// Whether bodies move with their velocity at the end of the step, as by impulses.
  bool moves_at_end_rate = false;
};

/// Clears the impulses that would warm start the rows.
void forget_impulses(JointData* state);

/// Adds the rows of a joint with their targets to `rows`. Sets the bias of `state`, which ends with
/// its timeout.
void prepare_joint(const Joint& joint, const BodyState& a, const BodyState& b,
                   const JointStep& step, JointData& state, List<Row>* rows);

/// Writes the Jacobians of the rows of a joint at other states of the bodies.
void joint_jacobians(const Joint& joint, const BodyState& a, const BodyState& b,
                     const JointStep& step, const JointData& state, const Row* rows, int count,
                     Jacobian* J);
/// Returns the present elongation of the spring of a row [m or rad].
double spring_stretch(const Joint& joint, const JointState& state, const Row& row);

/// Takes forces and state from the solved rows, with the bodies after the step.
void read_joint(const Joint& joint, const BodyState& a, const BodyState& b, JointStep step,
                const Row* rows, int count, JointData& state);

/// Measures a joint that was added or repaired, or whose bodies were set; its error is closed from
/// now on. `t` is simulated time [s]; `b_turns`: whether body B moves and can turn.
void begin_joint(const Joint& joint, const BodyState& a, const BodyState& b, double t,
                 JointData& state, bool b_turns = true);

/// Adds the two rows of a coupling, with the Jacobians `J` of its two terms. Both rows hold value
/// and target of the whole coupling.
void prepare_coupling(const Joint& joint, const JointStep& step, const JointData& state,
                      const std::array<Jacobian, 2>& J, List<Row>* rows);

/// Returns the Jacobian of a coordinate at the start or the end of a step of impulses.
Jacobian coordinate_jacobian(const Joint& joint, const BodyState& a, const BodyState& b,
                             const JointStep& step, const JointData& state, int coordinate,
                             bool at_end);

/// Measures a joint without restarting its closing.
void measure_joint(const Joint& joint, const BodyState& a, const BodyState& b, const JointStep& now,
                   JointData& state);

/// Returns the frame on B that meets the rows of a joint that keeps axes; it does not move where
/// they are met. Coordinates of an open joint are measured with this frame. `radius` is
/// JointState::radius.
MovingFrame frame_where_met(const Joint& joint, const BodyState& a, const BodyState& b,
                            double radius);

/// Sets the coordinates of a joint that was just added, without whole turns from earlier values.
/// For a gear or pulley `state` already has the value of the coupling.
void begin_coordinates(const Joint& joint, const BodyState& a, const BodyState& b,
                       JointState& state);

/// Returns the wrench of a joint of a kind other than kDistance. `impulse` is per row and
/// coordinate, over a step of h [s].
World::JointWrench wrench_of(const Joint& joint, const BodyState& a, const BodyState& b,
                             const RowVector& impulse, double h);

/// Magnitudes that `break_force` and `break_torque` bound: [N] and [N m] of forces, [N s] and
/// [N m s] of impulses.
struct JointLoad {
  double force = 0.0, torque = 0.0;

  /// Whether `share` of the load is more than the joint bears.
  bool breaks(const Joint& joint, double share = 1.0) const {
    return (joint.break_force > 0.0 && share * force > joint.break_force) ||
           (joint.break_torque > 0.0 && share * torque > joint.break_torque);
  }
};

/// Returns the load of a joint. `rows`: forces or impulses per row and coordinate; `coupling`:
/// force or impulse of its coupling that is not part of `rows`.
JointLoad load_of(const Joint& joint, const BodyState& a, const BodyState& b, const RowVector& rows,
                  double coupling);

/// Returns the elastic energy of the springs of a joint [J].
double elastic_energy(const Joint& joint, const JointState& state);

/// Whether the joint is rigid, not a spring of kind kDistance.
inline bool is_rigid(const Joint& joint) {
  const DistanceJoint* const distance = if_distance(joint);
  return distance == nullptr || !distance->is_soft();
}

/// Whether the joint is rigid, without springs, limits, friction and force limits.
bool is_always_rigid(const Joint& joint);

/// Returns force and torque of a custom force at time t, about the centres of A and B.
Jacobian custom_wrench(const Joint& joint, const BodyState& a, const BodyState& b, double t);

/// Whether the joint is enabled and not broken.
inline bool acts(const Joint& joint, const JointState& state) {
  return joint.enabled && !state.broken;
}

// ---- for methods that need prescribed motions with their derivatives

/// Prescribed motion of a joint over an interval without jumps: by its motors, and by an error that
/// is being closed.
class PrescribedMotion {
 public:
  PrescribedMotion() = default;
  PrescribedMotion(const Joint& joint, const JointStep& span, JointData& state) {
    begin(joint, span, state);
  }
  /// Begins the next interval. Sets bias (mean over the interval) and saturated of `state`.
  void begin(const Joint& joint, const JointStep& span, JointData& state);
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
      const Motor &a = held_[i].motor, &b = before.held_[i].motor;
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
    Motor motor;
    double until = 0.0, braking = 0.0;  // end [s] and acceleration of braking; 0: no braking
    math::SineCosine phase;             // phase of the motor at start_
  };

  void hold(std::size_t i, double value, const Motor& motor);
  /// Returns the motion of the motor relative to `held.value`.
  Prescribed moved(const Held& held, double t) const {
    if (!is_driven_) return {};
    if (held.braking != 0.0) {
      const double left = held.until - t;
      return {0.5 * held.braking * left * left, -held.braking * left, held.braking};
    }
    return held.motor.is_moving() ? motor_course(held.motor, held.phase, t - start_) : Prescribed{};
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

/// Whether each error of a joint is within tolerance of 0, or of its prescribed value while the
/// joint closes errors, as exact integration needs.
bool fits(const Joint& joint, const BodyState& a, const BodyState& b, const JointStep& step,
          const JointData& state);

/// Adds the motion of the motors in an interval to travel and held positions.
void finish_span(const Joint& joint, const JointStep& span, JointData& state);

/// Takes forces and state of a step, with the bodies after it. `impulse`: per row and coordinate,
/// along d for a distance joint [N s]; `zeta`: the present bias [m/s].
void read_smooth_joint(const Joint& joint, const BodyState& a, const BodyState& b,
                       const JointStep& step, const RowVector& impulse, double zeta,
                       JointData& state);

/// Returns the coordinate for the value of its form, with whole turns nearest to `reference` for an
/// angle.
double reading(const ScalarForm& form, double value, double zero, double reference);

}  // namespace constraint_sim::engine
