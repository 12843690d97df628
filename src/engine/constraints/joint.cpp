#include "engine/constraints/joint.h"

#include <algorithm>
#include <cmath>
#include <tuple>

#include "engine/constraints/closing_errors.h"
#include "engine/constraints/coupling.h"
#include "engine/constraints/custom_code.h"
#include "engine/constraints/distance.h"
#include "engine/constraints/joint_kinds.h"
#include "engine/constraints/joint_load.h"
#include "engine/constraints/law.h"
#include "engine/math/list.h"
#include "engine/math/numbers.h"

namespace constraint_sim::engine {
namespace {

constexpr double kFits = kClosedError;  // largest error that counts as none [m]
// Share of the initial error below which a joint counts as closed.
constexpr double kClosedShare = 0.01;

const MovingFrame kHome;  // frame at home, without motion

Prescribed turn_to_close(const Joint& joint, const JointData& state, const JointStep& step,
                         double beta, bool at_end) {
  if (step.closing_time > 0.0)
    return closing_errors(joint, state, step.t + (at_end ? step.h : 0.0), step.closing_time)
        .share();
  return {at_end ? (1.0 - beta) * state.closing_share : state.closing_share, 0.0, 0.0};
}

Eigen::Matrix3d axes_on_b(const Joint& joint) {
  return joint.frame_b.value_or(Eigen::Quaterniond::Identity()).toRotationMatrix();
}

// Returns the translation [m] and the rotation vector [rad] of the frame on B that would bring the
// errors of all rows to zero, for joints that close their errors by moving this frame.
std::pair<Eigen::Vector3d, Eigen::Vector3d> opening_of(const Joint& joint, const BodyState& a,
                                                       const BodyState& b) {
  const JointForms& kind = forms(joint.kind);
  const JointVectors vectors(joint, a, b);
  Eigen::Vector3d open = Eigen::Vector3d::Zero();
  for (int k = 0; k < kind.separation_rows; ++k) {
    const RowForm& form = kind.row[k];
    open +=
        value(form, vectors) * vectors[form.u.kind == VectorKind::kSeparation ? form.v : form.u];
  }
  return {-(b.orientation.conjugate() * open), misalignment(kind.alignment, vectors)};
}

// Sets error, error_rate and reached_rate from poses and twists of the bodies; `zeta` is the
// present rate of the motor.
void measure_distance(const Joint& joint, const BodyState& a, const BodyState& b, double zeta,
                      JointState& state) {
  const AnchorPair anchors(joint, a, b);
  const Eigen::Vector3d d_dot = anchors.d_dot(a, b);
  const double length = anchors.d.norm();
  state.reached_rate = length > 0.0 ? anchors.d.dot(d_dot) / length : direction(anchors).dot(d_dot);
  state.error = distance_error(joint.distance, length, state.travel);
  const bool is_slack =
      (is_between_limits(joint.distance) || joint.distance.one_sided) && state.error == 0.0;
  state.error_rate = is_slack ? 0.0 : state.reached_rate - zeta;
}

// Returns the values of up to three rows from `first` on; rows along the axes of the world are d.
Eigen::Vector3d row_values(const JointForms& kind, int first, int count,
                           const JointVectors& vectors) {
  if (count > 0 && kind.row[first].v.kind == VectorKind::kWorldAxis) return vectors.d;
  Eigen::Vector3d values = Eigen::Vector3d::Zero();
  for (int i = 0; i < count; ++i) values[i] = value(kind.row[first + i], vectors);
  return values;
}

// Returns the rate of the norm of these values of rows.
double rate_of_norm(const Eigen::Vector3d& values, const JointForms& kind, int first, int count,
                    const JointVectors& vectors, const JointMotion& motion) {
  Eigen::Vector3d rates = Eigen::Vector3d::Zero();
  if (count > 0 && kind.row[first].v.kind == VectorKind::kWorldAxis)
    rates = motion.d_dot;
  else
    for (int i = 0; i < count; ++i) rates[i] = rate(kind.row[first + i], vectors, motion);
  const double norm = values.norm();
  return norm > 0.0 ? values.dot(rates) / norm : rates.x();
}

// Returns the error of a coordinate against its rigid motor, or else against its limits.
double coordinate_error(const CoordinateLaw& law, const CoordinateState& state) {
  if (law.motor && law.motor->is_rigid()) return state.position - state.held;
  return beyond_limits(law, state.position);
}

// Whether a coordinate is beyond its limits where its motor holds it.
bool is_beyond_limits(const Joint& joint, const JointState& state) {
  for (std::size_t i = 0; i < to_index(info(joint.kind).coordinates); ++i)
    if (may_lose_motion(joint.coordinates[i]) &&
        std::abs(beyond_limits(joint.coordinates[i], state.coordinates[i].position)) > kFits)
      return true;
  return false;
}

// Interval since a joint was last measured.
struct Passed {
  double h = 0.0;                   // [s]
  const double* counted = nullptr;  // JointStep::counted
  bool moves_at_end_rate = false;   // JointStep::moves_at_end_rate
};

// Returns a reference to unwrap an angle: the held or counted coordinate, or a prediction from the
// last value and the velocities with which the method moves bodies.
// A motor that closes an error is not yet where it holds the coordinate.
double expected(const Passed& passed, const CoordinateLaw& law, const CoordinateState& before,
                double velocity, int coordinate, bool is_closing) {
  if (is_held(law) && passed.h > 0.0 && !is_closing) return before.held;
  if (passed.counted != nullptr && !std::isnan(passed.counted[coordinate]))
    return passed.counted[coordinate];
  const double at_start = passed.moves_at_end_rate ? velocity : before.velocity;
  return integrated(before.position, passed.h, at_start, velocity);
}

// Sets position and velocity of the coordinates, and raises the error of the joint to their largest
// error.
void measure_coordinates(const Joint& joint, const JointVectors& vectors, const JointMotion& motion,
                         const Passed& passed, JointState& state) {
  const JointForms& kind = forms(joint.kind);
  for (int i = 0; i < kind.coordinates; ++i) {
    const ScalarForm& form = kind.coordinate[i];
    const CoordinateLaw& law = joint.coordinates[i];
    CoordinateState& coordinate = state.coordinates[i];
    const ValueAndRate now = value_and_rate(form, vectors, motion);
    coordinate.position = reading(form, now.value, law.zero,
                                  expected(passed, law, coordinate, now.rate, i, state.closing));
    coordinate.velocity = now.rate;
    if (law.is_none()) continue;
    const double metres = form.is_angle ? state.radius : 1.0;
    const double off = metres * coordinate_error(law, coordinate);
    if (std::abs(off) <= state.error) continue;
    state.error = std::abs(off);
    state.error_rate = metres * std::copysign(1.0, off) * (coordinate.velocity - coordinate.bias);
  }
  if (kind.coordinates > 0) state.reached_rate = state.coordinates[0].velocity;
}

// Measures a joint of a kind other than kDistance. Rows use the frame on B at home, coordinates the
// moving frame.
void measure_table_rows(const Joint& joint, const BodyState& a, const BodyState& b,
                        const Passed& passed, const MovingFrame& frame, JointState& state) {
  const JointForms& kind = forms(joint.kind);
  const JointVectors vectors(joint, a, b);
  const JointMotion motion(vectors, a, b);
  const int turns = kind.rows - kind.separation_rows;
  const Eigen::Vector3d separation = row_values(kind, 0, kind.separation_rows, vectors);
  state.error = separation.norm();
  state.error_rate = state.reached_rate =
      rate_of_norm(separation, kind, 0, kind.separation_rows, vectors, motion);
  if (kind.alignment != Alignment::kFree) {
    state.angle_error = misalignment(kind.alignment, vectors).norm();
    if (state.radius * state.angle_error > state.error) {
      const Eigen::Vector3d angles = row_values(kind, kind.separation_rows, turns, vectors);
      state.error = state.radius * state.angle_error;
      state.error_rate =
          state.radius * rate_of_norm(angles, kind, kind.separation_rows, turns, vectors, motion);
    }
  }
  if (kind.coordinates == 0) return;
  if (!frame.moves) return measure_coordinates(joint, vectors, motion, passed, state);
  const JointVectors now(joint, a, b, frame);
  JointMotion moves(now, a, b);
  moves.add(frame, b.orientation.toRotationMatrix());
  measure_coordinates(joint, now, moves, passed, state);
}

// Sets value and rate of the coupling of a screw from its coordinates.
void read_own_coupling(const Joint& joint, JointState& state) {
  if (!info(joint.kind).has_pitch) return;
  const CoordinateState &along = state.coordinates[0], &about = state.coordinates[1];
  state.coupling.value = along.position - lead(joint) * about.position;
  state.coupling.rate = along.velocity - lead(joint) * about.velocity;
}

// Returns the error of a coupling; 0 where the rope of a one-sided pulley is slack.
double coupling_error(const Joint& joint, const JointState& state) {
  const double off = state.coupling.value - state.coupling.constant;
  return joint.coupling.one_sided ? std::max(off, 0.0) : off;
}

// Raises the error of the joint to the error of its coupling.
void measure_coupling(const Joint& joint, JointState& state) {
  read_own_coupling(joint, state);
  const double off = coupling_error(joint, state);
  if (!info(joint.kind).has_pitch) state.reached_rate = state.coupling.rate;
  if (std::abs(off) <= state.error) return;
  state.error = std::abs(off);
  state.error_rate = std::copysign(1.0, off) * state.coupling.rate;
}

void measure_joint(const Joint& joint, const BodyState& a, const BodyState& b, double zeta,
                   const Passed& passed, const MovingFrame& frame, JointState& state) {
  if (has_length(joint.kind)) return measure_distance(joint, a, b, zeta, state);
  measure_table_rows(joint, a, b, passed, frame, state);
  if (info(joint.kind).couples) measure_coupling(joint, state);
}

// Returns the errors of all rows and coordinates.
RowVector row_errors(const Joint& joint, const BodyState& a, const BodyState& b,
                     const JointState& state) {
  RowVector errors = RowVector::Zero();
  if (has_length(joint.kind)) {
    errors[0] = state.error;
    return errors;
  }
  const JointForms& kind = forms(joint.kind);
  const JointVectors vectors(joint, a, b);
  for (int k = 0; k < kind.rows; ++k) errors[k] = value(kind.row[k], vectors);
  for (int i = 0; i < kind.coordinates; ++i) {
    const CoordinateState& coordinate = state.coordinates[i];
    if (is_held(joint.coordinates[i]) || may_lose_motion(joint.coordinates[i]))
      errors[kind.rows + i] = coordinate.position - coordinate.held;
    else if (!joint.coordinates[i].motor || !joint.coordinates[i].motor->is_rigid())
      errors[kind.rows + i] = beyond_limits(joint.coordinates[i], coordinate.position);
  }
  return errors;
}

bool is_closed(const JointData& state, const JointStep& step) {
  if (step.closing_time > 0.0)
    return step.t + step.h >= end_of_closing(state.to_close, step.closing_time);
  return std::abs(state.error) <= std::max(kFits, kClosedShare * std::abs(state.initial_error));
}

}  // namespace

MovingFrame frame_in(const Joint& joint, const JointStep& step, const JointData& state,
                     bool at_end) {
  if (!state.closing || !closes_by_frame(forms(joint.kind))) return {};
  const double beta = joint.baumgarte.value_or(step.beta);
  const Eigen::Vector3d shift =
      step.closing_time > 0.0 ? state.to_close.shift : Eigen::Vector3d(Eigen::Vector3d::Zero());
  return {joint.anchor_b, axes_on_b(joint), shift, state.to_close.turn,
          turn_to_close(joint, state, step, beta, at_end)};
}

void finish(const Joint& joint, const BodyState& a, const BodyState& b, const JointStep& step,
            double zeta, const RowVector& impulse, JointData& state) {
  const bool is_distance = has_length(joint.kind);
  const Passed passed{step.h, step.counted, step.moves_at_end_rate};
  if (is_distance)
    measure_distance(joint, a, b, zeta, state);
  else if (state.closing)
    measure_joint(joint, a, b, zeta, passed, frame_in(joint, step, state, true), state);
  else
    measure_joint(joint, a, b, zeta, passed, kHome, state);
  if (state.closing && step.closing_time == 0.0)
    state.closing_share *= 1.0 - joint.baumgarte.value_or(step.beta);
  if (state.closing) state.closing = !is_closed(state, step);
  if (is_custom_force(joint.kind))
    state.force = custom_wrench(joint, a, b, step.t + step.h).j3.norm();
  if (is_overloaded(joint, a, b, impulse, step.h, state)) state.broken = true;
}

void forget_impulses(JointData* state) {
  state->impulse.setZero();
  state->coupling_impulse = 0.0;
}

MovingFrame frame_where_met(const Joint& joint, const BodyState& a, const BodyState& b,
                            double radius) {
  if (!closes_by_frame(forms(joint.kind))) return {};
  const auto [shift, turn] = opening_of(joint, a, b);
  if (std::max(shift.norm(), radius * turn.norm()) <= kFits) return {};
  return {joint.anchor_b, axes_on_b(joint), shift, turn, Prescribed{1.0, 0.0, 0.0}};
}

double reading(const ScalarForm& form, double value, double zero, double reference) {
  return form.is_angle ? unwound(value + zero, reference) : value + zero;
}

void begin_coordinates(const Joint& joint, const BodyState& a, const BodyState& b,
                       JointState& state) {
  const JointForms& kind = forms(joint.kind);
  const JointVectors vectors(joint, a, b, frame_where_met(joint, a, b, state.radius));
  for (int i = 0; i < kind.coordinates; ++i) {
    CoordinateState& coordinate = state.coordinates[i];
    const CoordinateLaw& law = joint.coordinates[i];
    coordinate.position = coordinate.held = value(kind.coordinate[i], vectors) + law.zero;
    if (law.motor && law.motor->is_rigid())
      coordinate.held = law.motor->position.value_or(coordinate.position);
  }
  if (!info(joint.kind).couples) return;
  read_own_coupling(joint, state);
  state.coupling.constant = joint.coupling.value.value_or(state.coupling.value);
}

void begin_joint(const Joint& joint, const BodyState& a, const BodyState& b, double t,
                 JointData& state, bool b_turns) {
  const JointForms& kind = forms(joint.kind);
  for (std::size_t i = 0; i < to_index(kind.coordinates); ++i) {
    if (!may_lose_motion(joint.coordinates[i])) continue;
    state.coordinates[i].held = *joint.coordinates[i].motor->position;
    state.coordinates[i].braking = 0.0;
  }
  const bool is_by_frame = closes_by_frame(kind) && (kind.alignment != Alignment::kFree || b_turns);
  MovingFrame frame;
  state.to_close = {};
  if (is_by_frame && !state.broken) {
    std::tie(state.to_close.shift, state.to_close.turn) = opening_of(joint, a, b);
    state.closing_share = 1.0;
    frame = frame_where_met(joint, a, b, state.radius);
  }
  try {
    measure_joint(joint, a, b, state.bias, Passed{}, frame, state);
    state.to_close.offset = row_errors(joint, a, b, state);
  } catch (const CustomFailure&) {  // the next step reports the failure
    state.error = kInfinity;
  }
  const bool is_measured = std::isfinite(state.error);
  state.initial_error = is_measured ? state.error : 0.0;
  state.to_close.since = t;
  state.to_close.coupling = coupling_error(joint, state);
  if (is_by_frame) state.to_close.offset.head(kind.rows).setZero();
  state.closing = is_measured && acts(joint, state) && is_rigid(joint) &&
                  (std::abs(state.error) > kFits || is_beyond_limits(joint, state));
}

void measure_joint(const Joint& joint, const BodyState& a, const BodyState& b, const JointStep& now,
                   JointData& state) {
  measure_joint(joint, a, b, state.bias, Passed{}, frame_in(joint, now, state, false), state);
}

bool is_always_rigid(const Joint& joint) {
  if (joint.coupling.one_sided) return false;
  const auto* distance = if_distance(joint);
  if (distance == nullptr)
    return !any_coordinate(joint, [](const CoordinateLaw& law) {
      return is_one_sided(law) || !soft_law(law).is_none();
    });
  return !(distance->is_soft() || distance->is_limited()) && joint.motor.max_force == 0.0;
}

bool fits(const Joint& joint, const BodyState& a, const BodyState& b, const JointStep& step,
          const JointData& state) {
  // A motor that has lost its motion goes to its position by its force.
  const bool may_be_lost = any_coordinate(joint, may_lose_motion);
  if (!state.closing && !(may_be_lost && std::abs(state.error) > kFits))
    return std::abs(state.error) <= kFits;
  const ClosingErrors allowed = closing_errors(joint, state, step.t, step.closing_time);
  if (const auto* distance = if_distance(joint)) {
    const double error = state.error, most = allowed.of(0).value;
    const bool is_free_side = is_between_limits(*distance) && error * most >= 0.0;
    return std::abs(is_free_side && std::abs(error) <= std::abs(most) ? 0.0 : error - most) <=
           kFits;
  }
  const JointForms& kind = forms(joint.kind);
  const double coupling = state.coupling.value - state.coupling.constant - allowed.coupling().value;
  const bool is_slack = joint.coupling.one_sided && coupling <= kFits;
  if (info(joint.kind).couples && !is_slack && !(std::abs(coupling) <= kFits)) return false;
  // The moving frame on B is used, since coordinates with the frame at home may differ widely.
  const JointVectors vectors(joint, a, b, frame_in(joint, step, state, false));
  if (kind.alignment != Alignment::kFree) {
    Eigen::Vector3d open = Eigen::Vector3d::Zero();
    for (int k = 0; k < kind.separation_rows; ++k) open[k] = value(kind.row[k], vectors);
    const double angle = misalignment(kind.alignment, vectors).norm();
    if (!(std::max(open.norm(), state.radius * angle) <= kFits)) return false;
  }
  for (int i = 0; i < kind.coordinates; ++i) {
    const CoordinateLaw& law = joint.coordinates[i];
    const ScalarForm& form = kind.coordinate[i];
    const CoordinateState& coordinate = state.coordinates[i];
    if (!is_held(law)) {
      if (!state.closing && !(std::abs(beyond_limits(law, coordinate.position)) <= kFits))
        return false;
      continue;
    }
    const double q = reading(form, value(form, vectors), law.zero, coordinate.position);
    const double metres = form.is_angle ? state.radius : 1.0;
    if (!(metres * std::abs(q - coordinate.held - allowed.of(kind.rows + i).value) <= kFits))
      return false;
  }
  if (kind.alignment != Alignment::kFree) return true;
  double square = 0.0;
  for (int k = 0; k < kind.rows; ++k) {
    const double off = value(kind.row[k], vectors) - allowed.of(k).value;
    square += off * off;
  }
  return square <= kFits * kFits;
}

void read_integrated_joint(const Joint& joint, const BodyState& a, const BodyState& b,
                           const JointStep& step, const RowVector& impulse, double zeta,
                           JointData& state) {
  state.impulse = impulse;
  if (has_length(joint.kind)) {
    state.force = impulse[0] / step.h;
    return finish(joint, a, b, step, zeta, impulse, state);
  }
  RowVector done = impulse;
  add_own_coupling(joint, state.coupling_impulse, &done);
  note_force(joint, done, step.h, state);
  finish(joint, a, b, step, zeta, done, state);
}

}  // namespace constraint_sim::engine
