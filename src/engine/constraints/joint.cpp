#include "engine/constraints/joint.h"

#include <algorithm>
#include <cmath>

#include "engine/constraints/course.h"
#include "engine/constraints/distance.h"
#include "engine/constraints/joint_kinds.h"
#include "engine/constraints/target.h"

namespace constraint_sim::engine {
namespace {

constexpr double kFits = 1e-6;         // [m] an error no larger than this is none
constexpr double kClosedShare = 0.01;  // of the initial error: what is left counts as closed

// Sets the mean bias of a step, and returns the motor as it acts throughout it.
Motor drive(const DistanceJoint& distance, const JointStep& step, Motor motor, JointState& state) {
  state.saturated = false;
  state.bias = 0.0;
  // acts for what is left of its time, so that the travel does not hang on the tick
  motor.bias *= std::clamp((state.expires_at - step.t) / step.h, 0.0, 1.0);
  if (motor.bias == 0.0 && motor.amplitude == 0.0) return motor;
  double travel = motor_travel(motor, step.t, step.h);
  const double lowest = least_travel(distance);
  if (state.travel + travel < lowest) {
    travel = std::min(lowest - state.travel, 0.0);
    state.saturated = true;
    motor = Motor{};
    motor.bias = travel / step.h;
  }
  state.bias = travel / step.h;
  return motor;
}

// What the row may be off by at the start of the step, and the rate at which that goes.
struct Closing {
  double offset = 0.0;  // [m]
  double rate = 0.0;    // [m/s]

  Closing(const JointState& state, const JointStep& step, int component) {
    if (!state.closing || step.closing_time == 0.0) return;
    const double begun = step.t - state.closing_since;
    const double error = state.closing_offset[component];
    offset = error * closing_course(begun, step.closing_time).value;
    rate = (error * closing_course(begun + step.h, step.closing_time).value - offset) / step.h;
  }
};

// whether an error of this sign is one of the limit that the row keeps
bool is_beyond(const Row& limit, double error) {
  return limit.upper == 0.0 ? error > 0.0 : error < 0.0;
}

int prepare_rows(const DistanceJoint& distance, const Joint& joint, const AnchorPair& anchors,
                 const JointStep& step, JointState& state, Row* rows) {
  drive(distance, step, joint.motor, state);
  const double beta = joint.baumgarte.value_or(step.beta);
  const Closing closing(state, step, 0);
  const int count = write_distance_rows(distance, anchors, state.travel, rows);
  for (Row* row = rows; row != rows + count; ++row) {
    row->target = row->drive = state.bias;
    const bool is_limit = row->lower == 0.0 || row->upper == 0.0;
    const bool is_closing = !is_limit || is_beyond(*row, closing.offset);
    if (is_closing) row->C -= closing.offset;
    if (is_limit)
      aim_limit(*row, beta, step.h);
    else if (distance.is_soft())
      aim_soft(*row, distance.stiffness, distance.damping, step.h);
    else
      aim_rigid(*row, beta, step.h);
    if (is_closing) row->correction += closing.rate;
    if (joint.motor.max_force > 0.0) limit_force(*row, joint.motor.max_force, step.h);
  }
  return count;
}

// of every kind but kDistance
int prepare_table_rows(const Joint& joint, const JointVectors& vectors, const JointStep& step,
                       const JointState& state, Row* rows) {
  const JointKindInfo& kind = info(joint.kind);
  for (int k = 0; k < kind.rows; ++k) {
    const RowForm form = kind.row[static_cast<std::size_t>(k)];
    const Closing closing(state, step, k);
    rows[k].J = jacobian(form, vectors);
    rows[k].C = value(form, vectors) - closing.offset;
    aim_rigid(rows[k], joint.baumgarte.value_or(step.beta), step.h);
    rows[k].correction += closing.rate;
  }
  return kind.rows;
}

// error, error_rate and reached_rate from where the bodies are and how they move; zeta is the bias
// asked for now
void measure_distance(const Joint& joint, const BodyState& a, const BodyState& b, double zeta,
                      JointState& state) {
  const AnchorPair anchors(joint, a, b);
  const Eigen::Vector3d d_dot = anchors.d_dot(a, b);
  const double length = anchors.d.norm();
  state.reached_rate = length > 0.0 ? anchors.d.dot(d_dot) / length : direction(anchors).dot(d_dot);
  state.error = distance_error(joint.distance, length, state.travel);
  const bool is_slack = is_between_limits(joint.distance) && state.error == 0.0;
  state.error_rate = is_slack ? 0.0 : state.reached_rate - zeta;
}

// The norm of some values, and its rate.
struct NormAndRate {
  Eigen::Vector3d values = Eigen::Vector3d::Zero(), rates = Eigen::Vector3d::Zero();

  double norm() const { return values.norm(); }
  double rate() const {
    const double size = values.norm();
    return size > 0.0 ? values.dot(rates) / size : rates.x();
  }
};

// the same of every other kind
void measure_table_rows(const Joint& joint, const BodyState& a, const BodyState& b,
                        JointState& state) {
  const JointKindInfo& kind = info(joint.kind);
  const JointVectors vectors(joint, a, b);
  const JointMotion motion(vectors, a, b);
  NormAndRate separation, angle;
  for (int k = 0; k < kind.rows; ++k) {
    const RowForm form = kind.row[static_cast<std::size_t>(k)];
    NormAndRate& part = k < kind.separation_rows ? separation : angle;
    const int at = k < kind.separation_rows ? k : k - kind.separation_rows;
    part.values[at] = value(form, vectors);
    part.rates[at] = rate(form, vectors, motion);
  }
  state.error = separation.norm();
  state.error_rate = state.reached_rate = separation.rate();
  if (kind.alignment == Alignment::kFree) return;
  state.angle_error = misalignment(kind.alignment, vectors).norm();
  if (state.radius * state.angle_error <= state.error) return;
  state.error = state.radius * state.angle_error;
  state.error_rate = state.radius * angle.rate();
}

void measure_joint(const Joint& joint, const BodyState& a, const BodyState& b, double zeta,
                   JointState& state) {
  if (joint.kind == JointKind::kDistance)
    measure_distance(joint, a, b, zeta, state);
  else
    measure_table_rows(joint, a, b, state);
}

// errors of all rows
RowVector row_errors(const Joint& joint, const BodyState& a, const BodyState& b,
                     const JointState& state) {
  RowVector errors = RowVector::Zero();
  if (joint.kind == JointKind::kDistance) {
    errors[0] = state.error;
    return errors;
  }
  const JointKindInfo& kind = info(joint.kind);
  const JointVectors vectors(joint, a, b);
  for (int k = 0; k < kind.rows; ++k)
    errors[k] = value(kind.row[static_cast<std::size_t>(k)], vectors);
  return errors;
}

// what the step added to the motor's travel; a motor at its force limit gives way, and holds from
// then on what it has reached
void settle(const DistanceJoint& distance, const Joint& joint, const AnchorPair& anchors,
            const JointStep& step, const Row* rows, int count, JointState& state) {
  const double max_force = joint.motor.max_force;
  bool yields = false;
  state.force = 0.0;
  for (int k = 0; k < count; ++k) {
    const double impulse = rows[k].impulse + rows[k].correction_impulse;
    state.impulse[k] = rows[k].impulse;
    state.force += impulse / step.h;
    yields = yields || (max_force > 0.0 && std::abs(impulse) >= max_force * step.h);
  }
  if (!yields) {
    state.travel += state.bias * step.h;
    return;
  }
  state.saturated = true;
  state.closing = false;
  if (!distance.is_soft()) {
    state.travel += distance_error(distance, anchors.d.norm(), state.travel);
    state.travel = std::max(state.travel, least_travel(distance));
  }
}

// of every kind but kDistance
void settle_table_rows(const Joint& joint, const JointStep& step, const Row* rows, int count,
                       JointState& state) {
  Eigen::Vector3d impulse = Eigen::Vector3d::Zero();
  for (int k = 0; k < count; ++k) {
    state.impulse[k] = rows[k].impulse;
    if (k < info(joint.kind).separation_rows)
      impulse[k] = rows[k].impulse + rows[k].correction_impulse;
  }
  state.force = impulse.norm() / step.h;
}

bool is_closed(const JointState& state, const JointStep& step) {
  if (step.closing_time > 0.0) return step.t + step.h >= state.closing_since + step.closing_time;
  return std::abs(state.error) <= std::max(kFits, kClosedShare * std::abs(state.initial_error));
}

// what is left to do once it is known what the rows have done
void finish(const Joint& joint, const BodyState& a, const BodyState& b, const JointStep& step,
            double zeta, JointState& state) {
  measure_joint(joint, a, b, zeta, state);
  if (state.closing) state.closing = !is_closed(state, step);
  if (joint.break_force > 0.0 && std::abs(state.force) > joint.break_force) {
    state.broken = true;
    state.impulse.setZero();
  }
}

}  // namespace

void prepare_joint(const Joint& joint, const BodyState& a, const BodyState& b,
                   const JointStep& step, JointState& state, std::vector<Row>* rows) {
  const std::size_t first = rows->size();
  const bool is_distance = joint.kind == JointKind::kDistance;
  rows->resize(first +
               static_cast<std::size_t>(is_distance ? kMaxDistanceRows : info(joint.kind).rows));
  Row* const written = rows->data() + first;
  const int count =
      is_distance
          ? prepare_rows(joint.distance, joint, AnchorPair(joint, a, b), step, state, written)
          : prepare_table_rows(joint, JointVectors(joint, a, b), step, state, written);
  for (int k = 0; k < count; ++k)
    written[k].impulse = std::clamp(state.impulse[k], written[k].lower, written[k].upper);
  rows->resize(first + static_cast<std::size_t>(count));
}

void joint_jacobians(const Joint& joint, const BodyState& a, const BodyState& b, Jacobian* J) {
  if (joint.kind == JointKind::kDistance) {
    const AnchorPair anchors(joint, a, b);
    std::fill(J, J + kMaxDistanceRows, anchors.along(direction(anchors)));
    return;
  }
  const JointKindInfo& kind = info(joint.kind);
  const JointVectors vectors(joint, a, b);
  for (int k = 0; k < kind.rows; ++k)
    J[k] = jacobian(kind.row[static_cast<std::size_t>(k)], vectors);
}

void read_joint(const Joint& joint, const BodyState& a, const BodyState& b, const JointStep& step,
                const Row* rows, int count, JointState& state) {
  if (joint.kind == JointKind::kDistance)
    settle(joint.distance, joint, AnchorPair(joint, a, b), step, rows, count, state);
  else
    settle_table_rows(joint, step, rows, count, state);
  finish(joint, a, b, step, state.bias, state);
}

void begin_joint(const Joint& joint, const BodyState& a, const BodyState& b, double t,
                 JointState& state) {
  measure_joint(joint, a, b, state.bias, state);
  state.initial_error = state.error;
  state.closing_since = t;
  state.closing_offset = row_errors(joint, a, b, state);
  state.closing = !state.broken && is_rigid(joint) && std::abs(state.error) > kFits;
}

double elastic_energy(const Joint& joint, const JointState& state) {
  const auto* distance = if_distance(joint);
  if (distance == nullptr || state.broken) return 0.0;
  return 0.5 * distance->stiffness * state.error * state.error;
}

bool is_rigid(const Joint& joint) {
  const auto* distance = if_distance(joint);
  return distance == nullptr || !distance->is_soft();
}

bool is_always_rigid(const Joint& joint) {
  const auto* distance = if_distance(joint);
  return (distance == nullptr || !(distance->is_soft() || distance->is_limited())) &&
         joint.motor.max_force == 0.0;
}

// ---- for methods that take time and its derivatives

JointCourse::JointCourse(const Joint& joint, const JointStep& span, JointState& state)
    : start_(span.t) {
  if (const auto* distance = if_distance(joint)) {
    motor_ = drive(*distance, span, joint.motor, state);
    length_ = distance->length.value_or(0.0) + state.travel;
  }
  if (state.closing) {
    closing_since_ = state.closing_since;
    closing_time_ = span.closing_time;
    closing_offset_ = state.closing_offset;
  }
}

Course JointCourse::length(double t) const {
  const Course travel = motor_course(motor_, start_, t - start_);
  Course length{length_ + travel.value, travel.rate, travel.acceleration};
  if (!is_closing()) return length;
  const Course share = share_to_close(t);
  length.value += closing_offset_[0] * share.value;
  length.rate += closing_offset_[0] * share.rate;
  length.acceleration += closing_offset_[0] * share.acceleration;
  return length;
}

Course JointCourse::share_to_close(double t) const {
  return is_closing() ? closing_course(t - closing_since_, closing_time_) : Course{};
}

bool fits(const Joint& joint, const BodyState& a, const BodyState& b, const JointStep& step,
          const JointState& state) {
  if (!state.closing) return std::abs(state.error) <= kFits;
  const double share = closing_course(step.t - state.closing_since, step.closing_time).value;
  if (joint.kind == JointKind::kDistance)
    return std::abs(state.error - share * state.initial_error) <= kFits;
  // may be off by this, but not elsewhere
  const JointKindInfo& kind = info(joint.kind);
  const RowVector off = row_errors(joint, a, b, state) - share * state.closing_offset;
  Eigen::Vector3d separation = Eigen::Vector3d::Zero(), angle = separation;
  for (int k = 0; k < kind.rows; ++k)
    (k < kind.separation_rows ? separation[k] : angle[k - kind.separation_rows]) = off[k];
  return separation.norm() <= kFits && state.radius * angle.norm() <= kFits;
}

void finish_span(const JointStep& span, JointState& state) { state.travel += state.bias * span.h; }

void read_smooth_joint(const Joint& joint, const BodyState& a, const BodyState& b,
                       const JointStep& step, const RowVector& impulse, double zeta,
                       JointState& state) {
  state.impulse = impulse;
  const bool is_distance = joint.kind == JointKind::kDistance;
  double force = impulse[0];
  if (!is_distance) {
    Eigen::Vector3d separation = impulse.head<3>();
    for (int k = info(joint.kind).separation_rows; k < 3; ++k) separation[k] = 0.0;
    force = separation.norm();
  }
  state.force = force / step.h;
  finish(joint, a, b, step, zeta, state);
}

}  // namespace constraint_sim::engine
