#pragma once

#include <vector>

#include "constraint_sim/engine/joint.h"
#include "constraint_sim/engine/row.h"
#include "engine/constraints/anchor_pair.h"
#include "engine/constraints/course.h"

namespace constraint_sim::engine {

inline constexpr int kMaxDistanceRows = 2;

/// One step as a joint sees it.
struct JointStep {
  double t;             ///< simulated time at its start [s]
  double h;             ///< its length [s]
  double beta;          ///< Baumgarte's share unless the joint has its own
  double closing_time;  ///< [s] in which an error left by an edit is closed; 0: by Baumgarte
};

/// Adds the rows of a joint with their targets to `rows`. Sets the bias of `state`, and ends it
/// when its time is over.
void prepare_joint(const Joint& joint, const BodyState& a, const BodyState& b,
                   const JointStep& step, JointState& state, std::vector<Row>* rows);

/// Writes the Jacobians of those rows at other states of the bodies.
void joint_jacobians(const Joint& joint, const BodyState& a, const BodyState& b, Jacobian* J);

/// Reads back what the solved rows have done, at the positions after the step.
void read_joint(const Joint& joint, const BodyState& a, const BodyState& b, const JointStep& step,
                const Row* rows, int count, JointState& state);

/// Measures a joint just added or mended, or whose bodies were set; what it is off by is then to be
/// closed. `t` is simulated time [s].
void begin_joint(const Joint& joint, const BodyState& a, const BodyState& b, double t,
                 JointState& state);

/// Elastic energy [J]; 0 unless a spring.
double elastic_energy(const Joint& joint, const JointState& state);

/// Whether the joint promises to keep its value: springs do not.
bool is_rigid(const Joint& joint);

/// Whether it does so both ways and with any force.
bool is_always_rigid(const Joint& joint);

// ---- for methods that take time and its derivatives

/// What time asks of a joint in a span in which nothing jumps: by its motor, and by an error to be
/// closed.
class JointCourse {
 public:
  JointCourse() = default;
  /// Sets bias (the mean of the span) and saturated of `state`.
  JointCourse(const Joint& joint, const JointStep& span, JointState& state);

  bool is_driven() const { return motor_.bias != 0.0 || motor_.amplitude != 0.0; }
  bool is_closing() const { return closing_time_ > 0.0; }
  bool is_constant() const { return !is_driven() && !is_closing(); }
  /// Of a distance joint, at the simulated time t [s].
  Course length(double t) const;
  /// Each row of another kind is to be off by this share of offset().
  Course share_to_close(double t) const;
  const RowVector& offset() const { return closing_offset_; }
  /// The bias alone [m/s].
  double zeta(double t) const { return motor_course(motor_, start_, t - start_).rate; }

 private:
  Motor motor_;
  double start_ = 0.0;   // [s]
  double length_ = 0.0;  // then [m]
  double closing_since_ = 0.0, closing_time_ = 0.0;
  RowVector closing_offset_ = RowVector::Zero();
};

/// Whether a joint is off by no more than what it is closing, and so can be kept exactly from here.
bool fits(const Joint& joint, const BodyState& a, const BodyState& b, const JointStep& step,
          const JointState& state);

/// Adds what the motor moved in a span.
void finish_span(const JointStep& span, JointState& state);

/// Takes over what a step has done, at the positions after it. `impulse`: of each row, of a
/// distance joint along d [N s]; `zeta`: the bias asked for now [m/s].
void read_smooth_joint(const Joint& joint, const BodyState& a, const BodyState& b,
                       const JointStep& step, const RowVector& impulse, double zeta,
                       JointState& state);

}  // namespace constraint_sim::engine
