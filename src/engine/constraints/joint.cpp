#include "engine/constraints/joint.h"

#include <algorithm>
#include <cmath>
#include <tuple>

#include "engine/constraints/coupling.h"
#include "engine/constraints/course.h"
#include "engine/constraints/distance.h"
#include "engine/constraints/joint_kinds.h"
#include "engine/constraints/law.h"
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

std::size_t at(int i) { return static_cast<std::size_t>(i); }

const MovingFrame kHome;  // which does not move

// Sets the mean bias of a coordinate, and returns its motor as it acts throughout the step.
Motor drive(const CoordinateLaw& law, const JointStep& step, CoordinateState* state) {
  Motor motor = *law.motor;
  if (motor.timeout > 0.0)
    motor.bias *= std::clamp((state->expires_at - step.t) / step.h, 0.0, 1.0);
  if (law.motor->position) {
    motor = Motor{};
    state->held = *law.motor->position;
  }
  state->bias = motor.is_moving() ? motor_travel(motor, step.t, step.h) / step.h : 0.0;
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

Course turn_to_close(const JointState& state, const JointStep& step, double beta, bool at_end) {
  if (step.closing_time > 0.0)
    return closing_course(step.t - state.closing_since + (at_end ? step.h : 0.0),
                          step.closing_time);
  return {at_end ? (1.0 - beta) * state.closing_share : state.closing_share, 0.0, 0.0};
}

// Where the frame on B would meet the rows, of a joint that keeps axes: shift and turn.
std::pair<Eigen::Vector3d, Eigen::Vector3d> opening_of(const Joint& joint, const BodyState& a,
                                                       const BodyState& b) {
  const JointKindInfo& kind = info(joint.kind);
  const JointVectors vectors(joint, a, b);
  Eigen::Vector3d open = Eigen::Vector3d::Zero();
  for (int k = 0; k < kind.separation_rows; ++k) {
    const RowForm& form = kind.row[at(k)];
    open +=
        value(form, vectors) * vectors[form.u.kind == VectorKind::kSeparation ? form.v : form.u];
  }
  return {-(b.orientation.conjugate() * open), misalignment(kind.alignment, vectors)};
}

// The frame on B at the start or the end of a step. By a share of the error a step only the turn
// goes by the frame.
MovingFrame frame_in(const Joint& joint, const JointStep& step, const JointState& state,
                     bool at_end) {
  const bool keeps_axes = info(joint.kind).alignment != Alignment::kFree;
  if (!state.closing || !keeps_axes) return {};
  const double beta = joint.baumgarte.value_or(step.beta);
  const Eigen::Vector3d shift =
      step.closing_time > 0.0 ? state.closing_shift : Eigen::Vector3d(Eigen::Vector3d::Zero());
  return {joint.anchor_b, joint.frame_b->toRotationMatrix(), shift, state.closing_turn,
          turn_to_close(state, step, beta, at_end)};
}

// of every kind but kDistance
int prepare_table_rows(const Joint& joint, const BodyState& a, const BodyState& b,
                       const JointStep& step, JointState& state, Row* rows) {
  const JointKindInfo& kind = info(joint.kind);
  const MovingFrame frame = frame_in(joint, step, state, false);
  const JointVectors vectors(joint, a, b, frame);
  const JointMotion motion(vectors, a, b);
  JointVectors ahead;
  if (frame.moves) ahead = JointVectors(joint, a, b, frame_in(joint, step, state, true));
  const double beta = joint.baumgarte.value_or(step.beta);
  for (int k = 0; k < kind.rows; ++k) {
    const RowForm form = kind.row[at(k)];
    const Closing closing(state, step, k);
    rows[k].J = jacobian(form, vectors);
    rows[k].C = value(form, vectors) - closing.offset;
    rows[k].component = k;
    aim_rigid(rows[k], beta, step.h);
    rows[k].correction += closing.rate;
    if (frame.moves) rows[k].correction -= (value(form, ahead) - value(form, vectors)) / step.h;
  }
  int count = kind.rows;
  state.saturated = false;
  for (int i = 0; i < kind.coordinates; ++i) {
    const CoordinateLaw& law = joint.coordinates[at(i)];
    CoordinateState& coordinate = state.coordinates[at(i)];
    coordinate.bias = 0.0;
    if (law.is_none()) continue;
    const ScalarForm& form = kind.coordinate[at(i)];
    CoordinateStep asked{step.h, beta, 0.0, coordinate.held};
    const Closing closing(state, step, kind.rows + i);
    if (law.motor && law.motor->is_rigid()) {
      drive(law, step, &coordinate);
      asked.bias = coordinate.bias + closing.rate;
      asked.target = coordinate.held + closing.offset;
    }
    const CoordinateMotion moves{reading(form, value(form, vectors), law.zero, coordinate.position),
                                 rate(form, vectors, motion), jacobian(form, vectors)};
    const int written = write_law_rows(law, moves, asked, kind.rows + i, rows + count);
    for (int k = count; k < count + written; ++k) rows[k].coordinate = i;
    count += written;
  }
  state.bias = state.coordinates[0].bias;
  return count;
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

// What a coordinate is off by, of what its motor and its limits ask, and the rate of that.
double coordinate_error(const CoordinateLaw& law, const CoordinateState& state) {
  if (law.motor && law.motor->is_rigid()) return state.position - state.held;
  return beyond_limits(law, state.position);
}

// What has passed since a joint was measured before.
struct Passed {
  double h = 0.0;                   // [s]
  const double* counted = nullptr;  // as JointStep has it
};

// Near where a coordinate reads now, that was at `before` and now moves at this velocity.
double expected(const Passed& passed, const CoordinateLaw& law, const CoordinateState& before,
                double velocity, int coordinate) {
  if (is_held(law) && passed.h > 0.0) return before.held;
  if (passed.counted != nullptr && !std::isnan(passed.counted[coordinate]))
    return passed.counted[coordinate];
  return before.position + 0.5 * passed.h * (before.velocity + velocity);
}

// Where coordinates are and how fast they move; and what they are off by, where that is more than
// the rows are.
void measure_coordinates(const Joint& joint, const JointVectors& vectors, const JointMotion& motion,
                         const Passed& passed, JointState& state) {
  const JointKindInfo& kind = info(joint.kind);
  for (int i = 0; i < kind.coordinates; ++i) {
    const ScalarForm& form = kind.coordinate[at(i)];
    const CoordinateLaw& law = joint.coordinates[at(i)];
    CoordinateState& coordinate = state.coordinates[at(i)];
    const double velocity = rate(form, vectors, motion);
    coordinate.position = reading(form, value(form, vectors), law.zero,
                                  expected(passed, law, coordinate, velocity, i));
    coordinate.velocity = velocity;
    if (law.is_none()) continue;
    const double metres = form.is_angle ? state.radius : 1.0;
    const double off = metres * coordinate_error(law, coordinate);
    if (std::abs(off) <= state.error) continue;
    state.error = std::abs(off);
    state.error_rate = metres * std::copysign(1.0, off) * (coordinate.velocity - coordinate.bias);
  }
  if (kind.coordinates > 0) state.reached_rate = state.coordinates[0].velocity;
}

// The same of every other kind: rows by the frame on B at home, coordinates by where it is now.
void measure_table_rows(const Joint& joint, const BodyState& a, const BodyState& b,
                        const Passed& passed, const MovingFrame& frame, JointState& state) {
  const JointKindInfo& kind = info(joint.kind);
  const JointVectors vectors(joint, a, b);
  const JointMotion motion(vectors, a, b);
  NormAndRate separation, angle;
  for (int k = 0; k < kind.rows; ++k) {
    const RowForm form = kind.row[at(k)];
    NormAndRate& part = k < kind.separation_rows ? separation : angle;
    const int i = k < kind.separation_rows ? k : k - kind.separation_rows;
    part.values[i] = value(form, vectors);
    part.rates[i] = rate(form, vectors, motion);
  }
  state.error = separation.norm();
  state.error_rate = state.reached_rate = separation.rate();
  if (kind.alignment != Alignment::kFree) {
    state.angle_error = misalignment(kind.alignment, vectors).norm();
    if (state.radius * state.angle_error > state.error) {
      state.error = state.radius * state.angle_error;
      state.error_rate = state.radius * angle.rate();
    }
  }
  if (kind.coordinates == 0) return;
  if (!frame.moves) return measure_coordinates(joint, vectors, motion, passed, state);
  const JointVectors now(joint, a, b, frame);
  JointMotion moves(now, a, b);
  moves.add(frame, b.orientation.toRotationMatrix());
  measure_coordinates(joint, now, moves, passed, state);
}

// of a screw, from its coordinates
void read_own_coupling(const Joint& joint, JointState& state) {
  if (!has_pitch(joint.kind)) return;
  const CoordinateState &along = state.coordinates[0], &about = state.coordinates[1];
  state.coupling.value = along.position - lead(joint) * about.position;
  state.coupling.rate = along.velocity - lead(joint) * about.velocity;
}

// what the coupling is off by, where that is more than the rows are
void measure_coupling(const Joint& joint, JointState& state) {
  read_own_coupling(joint, state);
  const double off = state.coupling.value - state.coupling.constant;
  if (!has_pitch(joint.kind)) state.reached_rate = state.coupling.rate;
  if (std::abs(off) <= state.error) return;
  state.error = std::abs(off);
  state.error_rate = std::copysign(1.0, off) * state.coupling.rate;
}

void measure_joint(const Joint& joint, const BodyState& a, const BodyState& b, double zeta,
                   const Passed& passed, const MovingFrame& frame, JointState& state) {
  if (if_distance(joint) != nullptr) return measure_distance(joint, a, b, zeta, state);
  measure_table_rows(joint, a, b, passed, frame, state);
  if (couples(joint.kind)) measure_coupling(joint, state);
}

// errors of all rows
RowVector row_errors(const Joint& joint, const BodyState& a, const BodyState& b,
                     const JointState& state) {
  RowVector errors = RowVector::Zero();
  if (if_distance(joint) != nullptr) {
    errors[0] = state.error;
    return errors;
  }
  const JointKindInfo& kind = info(joint.kind);
  const JointVectors vectors(joint, a, b);
  for (int k = 0; k < kind.rows; ++k) errors[k] = value(kind.row[at(k)], vectors);
  for (int i = 0; i < kind.coordinates; ++i) {
    const CoordinateState& coordinate = state.coordinates[at(i)];
    if (is_held(joint.coordinates[at(i)]))
      errors[kind.rows + i] = coordinate.position - coordinate.held;
  }
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

// of the force of a joint that is no distance joint, by what each row and coordinate has done
void note_force(const Joint& joint, const RowVector& impulse, double h, JointState& state) {
  const JointKindInfo& kind = info(joint.kind);
  for (int i = 0; i < kind.coordinates; ++i)
    state.coordinates[at(i)].effort = impulse[kind.rows + i] / h;
  Eigen::Vector3d separation = impulse.head<3>();
  for (int k = kind.separation_rows; k < 3; ++k) separation[k] = 0.0;
  state.force = kind.coordinates > 0 ? state.coordinates[0].effort : separation.norm() / h;
  if (couples_joints(joint.kind)) state.force = state.coupling.effort;
}

// a screw's row acts along coordinates of its own
void add_own_coupling(const Joint& joint, double impulse, RowVector* done) {
  if (!has_pitch(joint.kind)) return;
  const int along = info(joint.kind).rows;
  (*done)[along] += impulse;
  (*done)[along + 1] -= lead(joint) * impulse;
}

// whether a joint of such a kind breaks by what its rows and coordinates have done
bool breaks(const Joint& joint, const BodyState& a, const BodyState& b, const RowVector& impulse,
            double h, const JointState& state) {
  if (joint.break_force == 0.0 && joint.break_torque == 0.0) return false;
  if (couples_joints(joint.kind)) return std::abs(state.coupling.effort) > joint.break_force;
  const World::JointWrench wrench = wrench_of(joint, a, b, impulse, h);
  return (joint.break_force > 0.0 && wrench.force.norm() > joint.break_force) ||
         (joint.break_torque > 0.0 && wrench.torque.norm() > joint.break_torque);
}

// Of every kind but kDistance: what each row and coordinate has done. A motor at its force limit
// gives way, and holds from then on what it has reached.
RowVector settle_table_rows(const Joint& joint, const JointVectors& vectors, const JointStep& step,
                            const Row* rows, int count, JointState& state) {
  const JointKindInfo& kind = info(joint.kind);
  RowVector done = RowVector::Zero();
  state.impulse.setZero();
  for (int i = 0; i < kind.coordinates; ++i)
    if (joint.coordinates[at(i)].motor)
      state.coordinates[at(i)].held += state.coordinates[at(i)].bias * step.h;
  for (const Row* row = rows; row != rows + count; ++row) {
    const double impulse = row->impulse + row->correction_impulse;
    if (row->coordinate == kOfCoupling) {  // both have the same
      state.coupling.impulse = row->impulse;
      state.coupling.effort = impulse / step.h;
      continue;
    }
    const int component = row->coordinate < 0 ? row->component : kind.rows + row->coordinate;
    done[component] += impulse;
    if (row->component < 0) continue;
    state.impulse[row->component] = row->impulse;
    if (row->coordinate < 0) continue;
    const double most = joint.coordinates[at(row->coordinate)].motor->max_force * step.h;
    if (most == 0.0 || std::abs(impulse) < most) continue;
    state.saturated = true;
    CoordinateState& coordinate = state.coordinates[at(row->coordinate)];
    const ScalarForm& form = kind.coordinate[at(row->coordinate)];
    coordinate.held =
        reading(form, value(form, vectors), joint.coordinates[at(row->coordinate)].zero,
                coordinate.position + 0.5 * step.h * (coordinate.velocity + coordinate.bias));
  }
  return done;
}

bool is_closed(const JointState& state, const JointStep& step) {
  if (step.closing_time > 0.0) return step.t + step.h >= state.closing_since + step.closing_time;
  return std::abs(state.error) <= std::max(kFits, kClosedShare * std::abs(state.initial_error));
}

// what is left to do once it is known what the rows have done
void finish(const Joint& joint, const BodyState& a, const BodyState& b, const JointStep& step,
            double zeta, const RowVector& impulse, JointState& state) {
  const bool is_distance = if_distance(joint) != nullptr;
  const Passed passed{step.h, step.counted};
  if (is_distance)
    measure_distance(joint, a, b, zeta, state);
  else if (state.closing)
    measure_joint(joint, a, b, zeta, passed, frame_in(joint, step, state, true), state);
  else
    measure_joint(joint, a, b, zeta, passed, kHome, state);
  if (state.closing && step.closing_time == 0.0)
    state.closing_share *= 1.0 - joint.baumgarte.value_or(step.beta);
  if (state.closing) state.closing = !is_closed(state, step);
  if (is_distance ? joint.break_force > 0.0 && std::abs(state.force) > joint.break_force
                  : breaks(joint, a, b, impulse, step.h, state)) {
    state.broken = true;
    forget_impulses(&state);
  }
}

}  // namespace

void forget_impulses(JointState* state) {
  state->impulse.setZero();
  state->coupling.impulse = 0.0;
}

void prepare_joint(const Joint& joint, const BodyState& a, const BodyState& b,
                   const JointStep& step, JointState& state, std::vector<Row>* rows) {
  const std::size_t first = rows->size();
  const bool is_distance = if_distance(joint) != nullptr;
  const JointKindInfo& kind = info(joint.kind);
  rows->resize(first +
               at(is_distance ? kMaxDistanceRows : kind.rows + kMaxLawRows * kind.coordinates));
  Row* const written = rows->data() + first;
  int count = 0;
  if (is_distance) {
    count = prepare_rows(joint.distance, joint, AnchorPair(joint, a, b), step, state, written);
    for (int k = 0; k < count; ++k) written[k].component = k;
  } else {
    count = prepare_table_rows(joint, a, b, step, state, written);
  }
  for (Row* row = written; row != written + count; ++row)
    if (row->component >= 0)
      row->impulse = std::clamp(state.impulse[row->component], row->lower, row->upper);
  rows->resize(first + static_cast<std::size_t>(count));
}

void joint_jacobians(const Joint& joint, const BodyState& a, const BodyState& b,
                     const JointStep& step, const JointState& state, const Row* rows, int count,
                     Jacobian* J) {
  if (if_distance(joint) != nullptr) {
    const AnchorPair anchors(joint, a, b);
    std::fill(J, J + count, anchors.along(direction(anchors)));
    return;
  }
  const JointKindInfo& kind = info(joint.kind);
  const JointVectors vectors(joint, a, b, frame_in(joint, step, state, true));
  for (int k = 0; k < count && rows[k].coordinate != kOfCoupling; ++k)
    J[k] = jacobian(rows[k].coordinate < 0 ? kind.function[at(rows[k].component)]
                                           : kind.coordinate[at(rows[k].coordinate)],
                    vectors);
}

void prepare_coupling(const Joint& joint, const JointStep& step, const JointState& state,
                      const std::array<Jacobian, 2>& J, std::vector<Row>* rows) {
  Row row;
  row.coordinate = kOfCoupling;
  row.normal_row = Row::kCoupled;
  row.J = J[0];
  row.C = state.coupling.value - state.coupling.constant;
  double rate = 0.0;
  if (state.closing && step.closing_time > 0.0) {
    const double begun = step.t - state.closing_since;
    const double left = state.coupling.offset * closing_course(begun, step.closing_time).value;
    row.C -= left;
    rate =
        (state.coupling.offset * closing_course(begun + step.h, step.closing_time).value - left) /
        step.h;
  }
  aim_rigid(row, joint.baumgarte.value_or(step.beta), step.h);
  row.correction += rate;
  row.impulse = state.coupling.impulse;
  rows->push_back(row);
  row.normal_row = Row::kCoupledPart;
  row.J = J[1];
  rows->push_back(row);
}

Jacobian coordinate_jacobian(const Joint& joint, const BodyState& a, const BodyState& b,
                             const JointStep& step, const JointState& state, int coordinate,
                             bool at_end) {
  return jacobian(info(joint.kind).coordinate[at(coordinate)],
                  JointVectors(joint, a, b, frame_in(joint, step, state, at_end)));
}

double spring_stretch(const Joint& joint, const JointState& state, const Row& row) {
  if (row.coordinate < 0) return state.error;
  const CoordinateLaw& law = joint.coordinates[at(row.coordinate)];
  const bool is_servo = law.motor && law.motor->is_servo() && law.motor->max_force > 0.0 &&
                        row.stiffness == law.motor->servo_stiffness;
  return state.coordinates[at(row.coordinate)].position -
         (is_servo ? *law.motor->position : soft_law(law).R);
}

void read_joint(const Joint& joint, const BodyState& a, const BodyState& b, const JointStep& step,
                const Row* rows, int count, JointState& state) {
  if (if_distance(joint) != nullptr) {
    settle(joint.distance, joint, AnchorPair(joint, a, b), step, rows, count, state);
    return finish(joint, a, b, step, state.bias, state.impulse, state);
  }
  RowVector done = settle_table_rows(joint, JointVectors(joint, a, b), step, rows, count, state);
  add_own_coupling(joint, state.coupling.effort * step.h, &done);
  note_force(joint, done, step.h, state);
  finish(joint, a, b, step, state.bias, done, state);
}

MovingFrame frame_where_met(const Joint& joint, const BodyState& a, const BodyState& b,
                            double radius) {
  if (info(joint.kind).alignment == Alignment::kFree) return {};
  const auto [shift, turn] = opening_of(joint, a, b);
  if (std::max(shift.norm(), radius * turn.norm()) <= kFits) return {};
  return {joint.anchor_b, joint.frame_b->toRotationMatrix(), shift, turn, Course{1.0, 0.0, 0.0}};
}

double reading(const ScalarForm& form, double value, double zero, double reference) {
  return form.is_angle ? unwound(value + zero, reference) : value + zero;
}

void begin_coordinates(const Joint& joint, const BodyState& a, const BodyState& b,
                       JointState& state) {
  const JointKindInfo& kind = info(joint.kind);
  const JointVectors vectors(joint, a, b, frame_where_met(joint, a, b, state.radius));
  for (int i = 0; i < kind.coordinates; ++i) {
    CoordinateState& coordinate = state.coordinates[at(i)];
    const CoordinateLaw& law = joint.coordinates[at(i)];
    coordinate.position = coordinate.held = value(kind.coordinate[at(i)], vectors) + law.zero;
    if (law.motor && law.motor->is_rigid())
      coordinate.held = law.motor->position.value_or(coordinate.position);
  }
  if (!couples(joint.kind)) return;
  read_own_coupling(joint, state);
  state.coupling.constant = joint.coupling.value.value_or(state.coupling.value);
}

World::JointWrench wrench_of(const Joint& joint, const BodyState& a, const BodyState& b,
                             const RowVector& impulse, double h) {
  const JointVectors vectors(joint, a, b);
  const JointKindInfo& kind = info(joint.kind);
  Jacobian sum;
  for (int k = 0; k < kind.rows + kind.coordinates; ++k)
    sum = combined(1.0, sum, impulse[k] / h, jacobian(kind.function[at(k)], vectors));
  const Eigen::Matrix3d to_joint = kind.has_frames ? Eigen::Matrix3d(vectors.axes_B.transpose())
                                                   : b.orientation.toRotationMatrix().transpose();
  return {to_joint * sum.j3, to_joint * (sum.j4 - vectors.r_B.cross(sum.j3))};
}

void begin_joint(const Joint& joint, const BodyState& a, const BodyState& b, double t,
                 JointState& state) {
  const JointKindInfo& kind = info(joint.kind);
  MovingFrame frame;
  if (kind.alignment != Alignment::kFree && !state.broken) {
    std::tie(state.closing_shift, state.closing_turn) = opening_of(joint, a, b);
    state.closing_share = 1.0;
    frame = frame_where_met(joint, a, b, state.radius);
  }
  measure_joint(joint, a, b, state.bias, Passed{}, frame, state);
  state.initial_error = state.error;
  state.closing_since = t;
  state.closing_offset = row_errors(joint, a, b, state);
  state.coupling.offset = state.coupling.value - state.coupling.constant;
  if (kind.alignment != Alignment::kFree) state.closing_offset.head(kind.rows).setZero();
  state.closing = acts(joint, state) && is_rigid(joint) && std::abs(state.error) > kFits;
}

void measure_joint(const Joint& joint, const BodyState& a, const BodyState& b, const JointStep& now,
                   JointState& state) {
  measure_joint(joint, a, b, state.bias, Passed{}, frame_in(joint, now, state, false), state);
}

double elastic_energy(const Joint& joint, const JointState& state) {
  if (!acts(joint, state)) return 0.0;
  if (const auto* distance = if_distance(joint))
    return 0.5 * distance->stiffness * state.error * state.error;
  double energy = 0.0;
  for (std::size_t i = 0; i < at(info(joint.kind).coordinates); ++i)
    energy += elastic_energy(joint.coordinates[i], state.coordinates[i].position);
  return energy;
}

bool is_rigid(const Joint& joint) {
  const auto* distance = if_distance(joint);
  return distance == nullptr || !distance->is_soft();
}

bool is_always_rigid(const Joint& joint) {
  const auto* distance = if_distance(joint);
  if (distance == nullptr)
    return !any_coordinate(joint, [](const CoordinateLaw& law) {
      return is_one_sided(law) || !soft_law(law).is_none();
    });
  return !(distance->is_soft() || distance->is_limited()) && joint.motor.max_force == 0.0;
}

// ---- for methods that take time and its derivatives

void JointCourse::begin(const Joint& joint, const JointStep& span, JointState& state) {
  if (is_closing()) *this = JointCourse{};
  const JointKindInfo& kind = info(joint.kind);
  start_ = span.t;
  is_driven_ = false;
  rows_ = kind.rows;
  count_ = at(kind.coordinates);
  if (const auto* distance = if_distance(joint)) {
    count_ = 1;
    rows_ = 0;
    const Motor motor = drive(*distance, span, joint.motor, state);
    hold(0, distance->length.value_or(0.0) + state.travel, motor);
  }
  for (std::size_t i = 0; i < at(kind.coordinates); ++i) {
    CoordinateState& coordinate = state.coordinates[i];
    coordinate.bias = 0.0;
    held_[i] = Held{};
    if (!is_held(joint.coordinates[i])) continue;
    const Motor motor = drive(joint.coordinates[i], span, &coordinate);
    hold(i, coordinate.held - joint.coordinates[i].zero, motor);
  }
  if (kind.coordinates > 0) state.bias = state.coordinates[0].bias;
  if (!state.closing) return;
  closing_since_ = state.closing_since;
  closing_time_ = span.closing_time;
  closing_offset_ = state.closing_offset;
  coupling_offset_ = state.coupling.offset;
  closing_shift_ = state.closing_shift;
  closing_turn_ = state.closing_turn;
  moves_frame_ = kind.alignment != Alignment::kFree;
}

void JointCourse::hold(std::size_t i, double value, const Motor& motor) {
  held_[i] = {value, motor};
  is_driven_ = is_driven_ || motor.is_moving();
}

Course JointCourse::length(double t) const {
  const Course travel = motor_course(held_[0].motor, start_, t - start_);
  Course length{held_[0].value + travel.value, travel.rate, travel.acceleration};
  if (!is_closing()) return length;
  const Course share = share_to_close(t);
  length.value += closing_offset_[0] * share.value;
  length.rate += closing_offset_[0] * share.rate;
  length.acceleration += closing_offset_[0] * share.acceleration;
  return length;
}

Course JointCourse::target(int function, double t) const {
  const Course share = share_to_close(t);
  const double offset = closing_offset_[function];
  Course target{offset * share.value, offset * share.rate, offset * share.acceleration};
  if (function < rows_) return target;
  const Held& held = held_[at(function - rows_)];
  const Course moved = motor_course(held.motor, start_, t - start_);
  target.value += held.value + moved.value;
  target.rate += moved.rate;
  target.acceleration += moved.acceleration;
  return target;
}

Course JointCourse::coupling(double t) const {
  if (coupling_offset_ == 0.0) return {};
  const Course share = share_to_close(t);
  return {coupling_offset_ * share.value, coupling_offset_ * share.rate,
          coupling_offset_ * share.acceleration};
}

Course JointCourse::share_to_close(double t) const {
  return is_closing() ? closing_course(t - closing_since_, closing_time_) : Course{};
}

bool fits(const Joint& joint, const BodyState& a, const BodyState& b, const JointStep& step,
          const JointState& state) {
  if (!state.closing) return std::abs(state.error) <= kFits;
  const double share = closing_course(step.t - state.closing_since, step.closing_time).value;
  if (if_distance(joint) != nullptr)
    return std::abs(state.error - share * state.initial_error) <= kFits;
  const JointKindInfo& kind = info(joint.kind);
  const double coupling = state.coupling.value - state.coupling.constant;
  if (couples(joint.kind) && !(std::abs(coupling - share * state.coupling.offset) <= kFits))
    return false;
  // with the frame on B where it is by now, of which the home frame's coordinates tell little
  const JointVectors vectors(joint, a, b, frame_in(joint, step, state, false));
  if (kind.alignment != Alignment::kFree) {
    Eigen::Vector3d open = Eigen::Vector3d::Zero();
    for (int k = 0; k < kind.separation_rows; ++k) open[k] = value(kind.row[at(k)], vectors);
    const double angle = misalignment(kind.alignment, vectors).norm();
    if (!(std::max(open.norm(), state.radius * angle) <= kFits)) return false;
  }
  // may be off by this, but not elsewhere
  const RowVector allowed = share * state.closing_offset;
  for (int i = 0; i < kind.coordinates; ++i) {
    const CoordinateLaw& law = joint.coordinates[at(i)];
    if (!is_held(law)) continue;
    const ScalarForm& form = kind.coordinate[at(i)];
    const CoordinateState& coordinate = state.coordinates[at(i)];
    const double q = reading(form, value(form, vectors), law.zero, coordinate.position);
    const double metres = form.is_angle ? state.radius : 1.0;
    if (!(metres * std::abs(q - coordinate.held - allowed[kind.rows + i]) <= kFits)) return false;
  }
  if (kind.alignment != Alignment::kFree) return true;
  double square = 0.0;
  for (int k = 0; k < kind.rows; ++k) {
    const double off = value(kind.row[at(k)], vectors) - allowed[k];
    square += off * off;
  }
  return square <= kFits * kFits;
}

void finish_span(const Joint& joint, const JointStep& span, JointState& state) {
  if (if_distance(joint) != nullptr) {
    state.travel += state.bias * span.h;
    return;
  }
  for (CoordinateState& coordinate : state.coordinates) coordinate.held += coordinate.bias * span.h;
}

void read_smooth_joint(const Joint& joint, const BodyState& a, const BodyState& b,
                       const JointStep& step, const RowVector& impulse, double zeta,
                       JointState& state) {
  state.impulse = impulse;
  RowVector done = impulse;
  if (if_distance(joint) != nullptr) {
    state.force = impulse[0] / step.h;
  } else {
    add_own_coupling(joint, state.coupling.impulse, &done);
    note_force(joint, done, step.h, state);
  }
  finish(joint, a, b, step, zeta, done, state);
}

}  // namespace constraint_sim::engine
