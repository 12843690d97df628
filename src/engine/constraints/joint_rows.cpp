#include "engine/constraints/joint_rows.h"

#include <algorithm>
#include <cmath>

#include "engine/constraints/closing_errors.h"
#include "engine/constraints/distance.h"
#include "engine/constraints/joint_kinds.h"
#include "engine/constraints/joint_load.h"
#include "engine/constraints/law.h"
#include "engine/constraints/prescribed.h"
#include "engine/constraints/prescribed_motion.h"
#include "engine/constraints/target.h"
#include "engine/math/list.h"

namespace constraint_sim::engine {
namespace {

// Errors that a joint still has to close at the start of the step, and their mean rates.
class ClosingInStep {
 public:
  ClosingInStep(const Joint& joint, const JointData& state, const JointStep& step)
      : before_(closing_errors(joint, state, step.t, step.closing_time)),
        after_(closing_errors(joint, state, step.t + step.h, step.closing_time)),
        h_(step.h) {}

  struct Part {
    double offset, rate;  // [m], [m/s]
  };
  Part of(int component) const { return part(before_.of(component), after_.of(component)); }
  Part coupling() const { return part(before_.coupling(), after_.coupling()); }

 private:
  Part part(const Prescribed& before, const Prescribed& after) const {
    return {before.value, (after.value - before.value) / h_};
  }

  ClosingErrors before_, after_;
  double h_;
};

// Whether an error of this sign violates the limit of the row.
bool is_beyond(const Row& limit, double error) {
  return limit.upper == 0.0 ? error > 0.0 : error < 0.0;
}

// Turns the row of a spring into that of a spring that only pulls. The damper acts from the step
// after the length has passed its natural value.
void pull_only(const DistanceJoint& distance, double h, Row* row) {
  row->upper = 0.0;
  if (row->C > 0.0) {
    set_bias_soft(*row, distance.stiffness, distance.damping, h);
  } else if (distance.stiffness > 0.0) {
    set_bias_soft(*row, distance.stiffness, 0.0, h);
  } else {
    row->lower = 0.0;
  }
}

int prepare_rows(const DistanceJoint& distance, const Joint& joint, const AnchorPair& anchors,
                 const JointStep& step, JointData& state, Row* rows) {
  drive(distance, step, joint.motor, state);
  const double beta = joint.baumgarte.value_or(step.beta);
  const ClosingInStep::Part closing = ClosingInStep(joint, state, step).of(0);
  const int count = write_distance_rows(distance, anchors, state.travel, rows);
  for (Row* row = rows; row != rows + count; ++row) {
    row->target = row->drive = state.bias;
    const bool is_limit = row->lower == 0.0 || row->upper == 0.0;
    const bool is_closing = !is_limit || is_beyond(*row, closing.offset);
    if (is_closing) row->C -= closing.offset;
    if (is_limit)
      set_bias_limit(*row, beta, step.h);
    else if (distance.one_sided)
      pull_only(distance, step.h, row);
    else if (distance.is_soft())
      set_bias_soft(*row, distance.stiffness, distance.damping, step.h);
    else
      set_bias_rigid(*row, beta, step.h);
    if (is_closing) row->correction += closing.rate;
    if (joint.motor.max_force > 0.0) limit_force(*row, joint.motor.max_force, step.h);
  }
  return count;
}

// Writes the rows of a joint of a kind other than kDistance.
int prepare_table_rows(const Joint& joint, const BodyState& a, const BodyState& b,
                       const JointStep& step, JointData& state, Row* rows) {
  const JointForms& kind = forms(joint.kind);
  const MovingFrame frame = frame_in(joint, step, state, false);
  const JointVectors vectors(joint, a, b, frame);
  const JointMotion motion(vectors, a, b);
  JointVectors ahead;
  if (frame.moves) ahead = JointVectors(joint, a, b, frame_in(joint, step, state, true));
  const double beta = joint.baumgarte.value_or(step.beta);
  const ClosingInStep errors(joint, state, step);
  for (int k = 0; k < kind.rows; ++k) {
    const RowForm form = kind.row[k];
    const ClosingInStep::Part closing = errors.of(k);
    rows[k].J = jacobian(form, vectors);
    rows[k].C = value(form, vectors) - closing.offset;
    rows[k].component = k;
    set_bias_rigid(rows[k], beta, step.h);
    rows[k].correction += closing.rate;
    if (frame.moves) rows[k].correction -= (value(form, ahead) - value(form, vectors)) / step.h;
  }
  int count = kind.rows;
  state.saturated = false;
  for (int i = 0; i < kind.coordinates; ++i) {
    const CoordinateLaw& law = joint.coordinates[i];
    CoordinateState& coordinate = state.coordinates[i];
    coordinate.bias = 0.0;
    if (law.is_none()) continue;
    const ScalarForm& form = kind.coordinate[i];
    CoordinateStep asked{step.h, beta, 0.0, coordinate.held};
    const ClosingInStep::Part closing = errors.of(kind.rows + i);
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

// Whether the row of a motor reached its force limit, without or with its correction, since
// corrections of other rows may reduce the sum a little. Contacts leave a part of it to the
// tolerance to which they are solved.
bool is_at_limit(const Row& row, double most) {
  constexpr double kAtForceLimit = 1.0 - 1e-6;
  return std::max(std::abs(row.impulse), std::abs(row.impulse + row.correction_impulse)) >=
         kAtForceLimit * most;
}

// Sets impulses and force, and adds the motion of the step to the motor's travel. A motor at its
// force limit yields, and then holds the reached length; that of a spring goes on.
void settle(const DistanceJoint& distance, const Joint& joint, const AnchorPair& anchors,
            const JointStep& step, const Row* rows, int count, JointData& state) {
  const double max_force = joint.motor.max_force;
  int yielding = -1;  // row at the force limit
  state.force = 0.0;
  for (int k = 0; k < count; ++k) {
    const double impulse = rows[k].impulse + rows[k].correction_impulse;
    state.impulse[k] = rows[k].impulse;
    state.force += impulse / step.h;
    if (max_force > 0.0 && is_at_limit(rows[k], max_force * step.h)) yielding = k;
  }
  if (yielding >= 0) {
    state.saturated = true;
    state.closing = false;
  }
  if (yielding < 0 || distance.is_soft()) {
    state.travel += state.bias * step.h;
    return;
  }
  // A rope shortens by at most what the motor winds, also where other rows are not solved well.
  const double wound = state.travel + state.bias * step.h;
  double reached = anchors.d.norm() - length_of_row(distance, yielding);
  if (rows[yielding].upper == 0.0) reached = std::max(reached, wound);
  if (rows[yielding].lower == 0.0) reached = std::min(reached, wound);
  state.travel = std::max(reached, least_travel(distance));
}

// Returns the impulses per row and coordinate, for a kind other than kDistance. A motor at its
// force limit yields, and then holds the reached position.
RowVector settle_table_rows(const Joint& joint, const JointVectors& vectors, const JointStep& step,
                            const Row* rows, int count, JointData& state) {
  const JointForms& kind = forms(joint.kind);
  RowVector done = RowVector::Zero();
  state.impulse.setZero();
  for (int i = 0; i < kind.coordinates; ++i)
    if (joint.coordinates[i].motor) state.coordinates[i].held += state.coordinates[i].bias * step.h;
  for (const Row* row = rows; row != rows + count; ++row) {
    const double impulse = row->impulse + row->correction_impulse;
    if (row->coordinate == kOfCoupling) {  // both rows of a coupling have equal impulses
      state.coupling_impulse = row->impulse;
      state.coupling.effort = impulse / step.h;
      continue;
    }
    const int component = row->coordinate < 0 ? row->component : kind.rows + row->coordinate;
    done[component] += impulse;
    if (row->component >= 0) state.impulse[row->component] = row->impulse;
    if (row->coordinate < 0) continue;
    const auto& motor = joint.coordinates[row->coordinate].motor;
    const bool is_first = row == rows || row[-1].coordinate != row->coordinate;
    // The first row of a coordinate is the motor's.
    if (!is_first || !motor || motor->max_force == 0.0) continue;
    if (!is_at_limit(*row, motor->max_force * step.h)) continue;
    state.saturated = true;
    if (row->component < 0) continue;  // a spring or constant force holds no position
    CoordinateState& coordinate = state.coordinates[row->coordinate];
    const ScalarForm& form = kind.coordinate[row->coordinate];
    coordinate.held =
        reading(form, value(form, vectors), joint.coordinates[row->coordinate].zero,
                coordinate.position + 0.5 * step.h * (coordinate.velocity + coordinate.bias));
  }
  return done;
}

}  // namespace

void prepare_joint(const Joint& joint, const BodyState& a, const BodyState& b,
                   const JointStep& step, JointData& state, List<Row>* rows) {
  const std::size_t first = rows->size();
  const bool is_distance = has_length(joint.kind);
  const JointForms& kind = forms(joint.kind);
  rows->resize(first + to_index(is_distance ? kMaxDistanceRows
                                            : kind.rows + kMaxLawRows * kind.coordinates));
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
                     const JointStep& step, const JointData& state, const Row* rows, int count,
                     Jacobian* J) {
  if (has_length(joint.kind)) {
    const AnchorPair anchors(joint, a, b);
    std::fill(J, J + count, anchors.along(direction(anchors)));
    return;
  }
  const JointForms& kind = forms(joint.kind);
  const JointVectors vectors(joint, a, b, frame_in(joint, step, state, true));
  for (int k = 0; k < count && rows[k].coordinate != kOfCoupling; ++k)
    J[k] = jacobian(rows[k].coordinate < 0 ? kind.function[rows[k].component]
                                           : kind.coordinate[rows[k].coordinate],
                    vectors);
}

void joint_values(const Joint& joint, const BodyState& a, const BodyState& b, const JointStep& step,
                  const JointData& state, const Row* rows, int count, double* values) {
  if (has_length(joint.kind)) {
    std::fill(values, values + count, AnchorPair(joint, a, b).d.norm());
    return;
  }
  const JointForms& kind = forms(joint.kind);
  const JointVectors vectors(joint, a, b, frame_in(joint, step, state, true));
  for (int k = 0; k < count; ++k)
    values[k] = rows[k].coordinate == -1 ? value(kind.row[rows[k].component], vectors) : 0.0;
}

void prepare_coupling(const Joint& joint, const JointStep& step, const JointData& state,
                      const std::array<Jacobian, 2>& J, List<Row>* rows) {
  Row row;
  row.coordinate = kOfCoupling;
  row.normal_row = Row::kCoupled;
  row.J = J[0];
  const ClosingInStep::Part closing = ClosingInStep(joint, state, step).coupling();
  row.C = state.coupling.value - state.coupling.constant - closing.offset;
  const double beta = joint.baumgarte.value_or(step.beta);
  if (joint.coupling.one_sided) {
    row.upper = 0.0;
    set_bias_limit(row, beta, step.h);
  } else {
    set_bias_rigid(row, beta, step.h);
  }
  row.correction += closing.rate;
  row.impulse = std::min(state.coupling_impulse, row.upper);
  rows->push_back(row);
  row.normal_row = Row::kCoupledPart;
  row.J = J[1];
  rows->push_back(row);
}

Jacobian coordinate_jacobian(const Joint& joint, const BodyState& a, const BodyState& b,
                             const JointStep& step, const JointData& state, int coordinate,
                             bool at_end) {
  return jacobian(forms(joint.kind).coordinate[coordinate],
                  JointVectors(joint, a, b, frame_in(joint, step, state, at_end)));
}

double spring_stretch(const Joint& joint, const JointState& state, const Row& row) {
  if (row.coordinate < 0) return state.error;
  const CoordinateLaw& law = joint.coordinates[row.coordinate];
  // Only a servo with a force limit has a row of its own, with bounds.
  const bool is_servo = law.motor && law.motor->is_servo() && std::isfinite(row.upper);
  return state.coordinates[row.coordinate].position -
         (is_servo ? *law.motor->position : soft_law(law).R);
}

void read_joint(const Joint& joint, const BodyState& a, const BodyState& b, JointStep step,
                const Row* rows, int count, JointData& state) {
  step.moves_at_end_rate = true;
  if (has_length(joint.kind)) {
    settle(joint.distance, joint, AnchorPair(joint, a, b), step, rows, count, state);
    return finish(joint, a, b, step, state.bias, state.impulse, state);
  }
  RowVector done = settle_table_rows(joint, JointVectors(joint, a, b), step, rows, count, state);
  add_own_coupling(joint, state.coupling.effort * step.h, &done);
  note_force(joint, done, step.h, state);
  finish(joint, a, b, step, state.bias, done, state);
}

}  // namespace constraint_sim::engine
