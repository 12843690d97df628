#pragma once

#include <utility>

#include "constraint_sim/engine/joint.h"
#include "constraint_sim/engine/row.h"
#include "constraint_sim/engine/world.h"
#include "engine/constraints/anchor_pair.h"
#include "engine/constraints/course.h"
#include "engine/constraints/law.h"
#include "engine/constraints/moving_frame.h"
#include "engine/math/list.h"

namespace constraint_sim::engine {

inline constexpr int kMaxDistanceRows = 2;
/// Of a row of the coupling, in place of a coordinate.
inline constexpr int kOfCoupling = -2;

/// One step as a joint sees it.
struct JointStep {
  double t;             ///< simulated time at its start [s]
  double h;             ///< its length [s]
  double beta;          ///< Baumgarte's share unless the joint has its own
  double closing_time;  ///< [s] in which an error left by an edit is closed; 0: by Baumgarte
  /// Where coordinates read at its end by a method that has counted turns within it; NaN, or no
  /// array, where it has not.
  const double* counted = nullptr;
};

/// Forgets what its rows did, with which they would be warm started.
void forget_impulses(JointState* state);

/// Adds the rows of a joint with their targets to `rows`. Sets the bias of `state`, and ends it
/// when its time is over.
void prepare_joint(const Joint& joint, const BodyState& a, const BodyState& b,
                   const JointStep& step, JointState& state, List<Row>* rows);

/// Writes the Jacobians of those rows at other states of the bodies.
void joint_jacobians(const Joint& joint, const BodyState& a, const BodyState& b,
                     const JointStep& step, const JointState& state, const Row* rows, int count,
                     Jacobian* J);
/// How far the spring of a row is from its rest, where the joint is now.
double spring_stretch(const Joint& joint, const JointState& state, const Row& row);

/// Reads back what the solved rows have done, at the positions after the step.
void read_joint(const Joint& joint, const BodyState& a, const BodyState& b, const JointStep& step,
                const Row* rows, int count, JointState& state);

/// Measures a joint just added or mended, or whose bodies were set; what it is off by is then to be
/// closed. `t` is simulated time [s]; `b_turns`: whether body B moves and can turn.
void begin_joint(const Joint& joint, const BodyState& a, const BodyState& b, double t,
                 JointState& state, bool b_turns = true);

/// Adds the two rows of the coupling of a joint, each with the bodies of one term; `a` and `b` are
/// those of the joint's own rows. Both have the value and the target of the whole in the first.
void prepare_coupling(const Joint& joint, const JointStep& step, const JointState& state,
                      const std::array<Jacobian, 2>& J, List<Row>* rows);

/// The gradient of a coordinate in a step of impulses, at its start or its end.
Jacobian coordinate_jacobian(const Joint& joint, const BodyState& a, const BodyState& b,
                             const JointStep& step, const JointState& state, int coordinate,
                             bool at_end);

/// Measures a joint that goes on being closed, or not, as its state says.
void measure_joint(const Joint& joint, const BodyState& a, const BodyState& b, const JointStep& now,
                   JointState& state);

/// The frame on B where it would meet the rows of a joint that keeps axes; it does not move where
/// they are met. By that frame coordinates read while the joint is open. `radius`: JointState's.
MovingFrame frame_where_met(const Joint& joint, const BodyState& a, const BodyState& b,
                            double radius);

/// Sets where the coordinates of a joint just added are: there, whatever they read then. Of a
/// coupling of other joints `state` has its value already.
void begin_coordinates(const Joint& joint, const BodyState& a, const BodyState& b,
                       JointState& state);

/// What a joint of another kind than kDistance does. `impulse`: of its rows and coordinates in a
/// step of h [s].
World::JointWrench wrench_of(const Joint& joint, const BodyState& a, const BodyState& b,
                             const RowVector& impulse, double h);

/// Elastic energy [J]; 0 unless a spring.
double elastic_energy(const Joint& joint, const JointState& state);

/// Whether the joint promises to keep its value: springs do not.
bool is_rigid(const Joint& joint);

/// Whether it does so both ways and with any force.
bool is_always_rigid(const Joint& joint);

/// Whether the joint is enabled and not broken.
/// Of a custom force at time t: forces and torques about the centres of A and B.
Jacobian custom_wrench(const Joint& joint, const BodyState& a, const BodyState& b, double t);

inline bool acts(const Joint& joint, const JointState& state) {
  return joint.enabled && !state.broken;
}

// ---- for methods that take time and its derivatives

/// What time asks of a joint in a span in which nothing jumps: by its motor, and by an error to be
/// closed.
class PrescribedMotion {
 public:
  PrescribedMotion() = default;
  PrescribedMotion(const Joint& joint, const JointStep& span, JointState& state) {
    begin(joint, span, state);
  }
  /// Takes the course of the next span. Sets bias (the mean of the span) and saturated of `state`.
  void begin(const Joint& joint, const JointStep& span, JointState& state);
  /// A coordinate comes to rest where it is to be held at a time [s], as it brakes by this much
  /// [m/s² or rad/s²], < 0 of one that comes from below.
  void brake(int coordinate, double until, double braking) {
    Held& held = held_[static_cast<std::size_t>(coordinate)];
    held.until = until;
    held.braking = braking;
    is_driven_ = true;
  }

  bool is_driven() const { return is_driven_; }
  /// Whether the motors go on as those of the span before.
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
  /// Of a distance joint, at the simulated time t [s].
  Prescribed length(double t) const;
  /// Each row of another kind is to be off by this share of offset().
  Prescribed share_to_close(double t) const;
  const RowVector& offset() const { return closing_offset_; }
  /// What the coupling is to be off by, and was when it began to be closed.
  Prescribed coupling(double t) const;
  double coupling_offset() const { return coupling_offset_; }
  /// Whether the frame on B moves while the joint is being closed.
  bool moves_frame() const { return is_closing() && moves_frame_; }
  /// The frame on B at time t, that is home there.
  MovingFrame frame(double t, const Eigen::Vector3d& anchor_b,
                    const Eigen::Matrix3d& frame_b) const {
    return {anchor_b, frame_b, closing_shift_, closing_turn_, share_to_close(t)};
  }
  /// Length of what the frame moves by [m], and its angle [rad].
  std::pair<double, double> opening() const {
    return {closing_shift_.norm(), closing_turn_.norm()};
  }
  /// Of another kind: what a row is to be off by, or what the form of a coordinate is to be.
  Prescribed target(int function, double t) const;
  /// The same without what closes an error: the rate that a motor asks of a row, or of the length.
  double driven_rate(int function, double t) const {
    if (function < rows_) return 0.0;
    return moved(held_[static_cast<std::size_t>(function - rows_)], t).rate;
  }
  /// The bias of a distance joint alone [m/s].
  double zeta(double t) const { return moved(held_[0], t).rate; }
  /// Visits all of it, as engine/memory.h says.
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
    for (auto* time : {&self.start_, &self.closing_since_, &self.closing_time_})
      visit.beside(*time);
    visit.beside(self.closing_offset_);
    visit.beside(self.coupling_offset_);
    visit.beside(self.closing_shift_);
    visit.beside(self.closing_turn_);
    visit.beside(self.moves_frame_);
    if constexpr (Visit::kReads) {
      for (auto& held : self.held_) held.phase = motor_phase(held.motor, self.start_);
    }
  }

 private:
  /// What a motor holds: the length of a distance joint, or a coordinate of another kind.
  struct Held {
    double value = 0.0;  // at the start, or where it comes to rest
    Motor motor;
    double until = 0.0, braking = 0.0;  // of one that does
    math::SineCosine phase;             // phase of the motor at start_
  };

  void hold(std::size_t i, double value, const Motor& motor);
  /// What its motor adds to the value at the start.
  Prescribed moved(const Held& held, double t) const {
    if (held.braking != 0.0 && t < held.until) {
      const double left = held.until - t;
      return {0.5 * held.braking * left * left, -held.braking * left, held.braking};
    }
    return held.motor.is_moving() ? motor_course(held.motor, held.phase, t - start_) : Prescribed{};
  }

  std::array<Held, kMaxCoordinates> held_;
  std::size_t count_ = 0;  // of these
  int rows_ = 0;           // of its kind, before these
  bool is_driven_ = false;
  double start_ = 0.0;  // [s]
  double closing_since_ = 0.0, closing_time_ = 0.0;
  RowVector closing_offset_ = RowVector::Zero();
  double coupling_offset_ = 0.0;
  Eigen::Vector3d closing_shift_ = Eigen::Vector3d::Zero();
  Eigen::Vector3d closing_turn_ = Eigen::Vector3d::Zero();
  bool moves_frame_ = false;
};

/// Whether a joint is off by no more than what it is closing, and so can be kept exactly from here.
bool fits(const Joint& joint, const BodyState& a, const BodyState& b, const JointStep& step,
          const JointState& state);

/// Adds what the motor moved in a span.
void finish_span(const Joint& joint, const JointStep& span, JointState& state);

/// Takes over what a step has done, at the positions after it. `impulse`: of each row and
/// coordinate, of a distance joint along d [N s]; `zeta`: the bias asked for now [m/s].
void read_smooth_joint(const Joint& joint, const BodyState& a, const BodyState& b,
                       const JointStep& step, const RowVector& impulse, double zeta,
                       JointState& state);

/// Where a coordinate reads, by what its form says there: the angle nearest to `reference`.
double reading(const ScalarForm& form, double value, double zero, double reference);

}  // namespace constraint_sim::engine
