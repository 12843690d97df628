#include "engine/methods/time_stepping/joint_curvature.h"

#include <algorithm>
#include <array>
#include <cmath>

#include "engine/constraints/anchor_pair.h"
#include "engine/constraints/joint_kinds.h"
#include "engine/constraints/joint_rows.h"
#include "engine/constraints/law.h"
#include "engine/math/numbers.h"

namespace constraint_sim::engine {
namespace {

using Start = ConvergedRows::Start;

// Largest turn of a body in a step [rad], and least cosine of the turn of a length, up to which
// joints are closed. Beyond them the repetitions hardly converge.
constexpr double kLargestTurn = 0.5, kLeastCosine = 0.88;
// Multiple of the rounding of a value up to which a joint counts as straight, so that joints at
// rest need no corrections.
constexpr double kRounded = 16.0;

// Most repetitions of corrections, which end where these change by less than this share of the
// speed that counts as rest.
constexpr int kMostRepetitions = 7;
constexpr double kClosed = 0.1;
// Share of a change of corrections above which the next one shows that they do not converge.
constexpr double kLargestRatio = 0.5;

// Whether the row is a rigid constraint whose position error may be nonlinear in the motion. False
// for springs, dampers, contacts and rows of coordinate laws.
bool holds_value(const Row& row) {
  return row.coordinate == -1 && row.normal_row == -1 && row.softness == 0.0;
}

bool turns_too_far(const BodyState& body, double h) {
  return !(h * body.angular_velocity.norm() <= kLargestTurn);
}

bool swings_too_far(const AnchorPair& start, const AnchorPair& end) {
  return !(start.d.dot(end.d) >= kLeastCosine * start.d.norm() * end.d.norm());
}

// Size of the numbers whose differences are the values of a joint [m].
double size_of(const Joint& joint, const BodyState& a, const BodyState& b) {
  return 1.0 + a.position.norm() + b.position.norm() + joint.anchor_a.norm() +
         joint.anchor_b.norm();
}

}  // namespace

ConvergedRows::Outcome JointCurvature::correct(const SteppedJoints& step, double rest_speed,
                                               StopFlag stop, ConvergedRows* converged,
                                               RowSolver* solver, List<Row>* rows) {
  const bool is_curved = step.move_by_end_velocity && !step.acting.empty();
  starts_.assign(step.states.size(), Start::kFirst);
  last_changes_.assign(step.states.size(), kInfinity);
  if (is_curved) {
    begin(step, *converged, *solver, rows);
    solver->find_corrections(*rows);
  }
  const auto solve = [&] {
    converged->correct(step.states, step.masses, rest_speed, starts_, stop, rows, solver);
  };
  solve();
  for (int k = 0; is_curved && k < kMostRepetitions && !is_set(stop) &&
                  repeat(step, kClosed * rest_speed, *solver, rows);
       ++k)
    solve();
  return converged->corrected();
}

// Lists the joints that can be closed, and adds −d/h of the present velocities to the corrections
// of their rows.
void JointCurvature::begin(const SteppedJoints& step, const ConvergedRows& converged,
                           const RowSolver& solver, List<Row>* rows) {
  by_errors_.resize(step.first_rows.back());
  at_start_.resize(by_errors_.size());
  for (std::size_t r = 0; r < by_errors_.size(); ++r) by_errors_[r] = (*rows)[r].correction;
  curved_.clear();
  for (std::size_t k = 0; k < step.acting.size(); ++k) {
    const auto first = rows->begin() + static_cast<std::ptrdiff_t>(step.first_rows[k]);
    const auto end = rows->begin() + static_cast<std::ptrdiff_t>(step.first_rows[k + 1]);
    if (std::any_of(first, end, holds_value) &&
        !converged.is_swept(solver.component(step.first_rows[k])))
      curved_.push_back(k);
  }
  find_ends(step, solver);
  leave_out_fast(step);
  for (const std::size_t k : curved_) {
    const std::size_t j = to_index(step.acting[k]), first = step.first_rows[k];
    const auto [a, b] = step.ends[j];
    joint_values(step.joints[j], step.states[a], step.states[b], step.interval,
                 step.joint_states[j], rows->data() + first,
                 static_cast<int>(step.first_rows[k + 1] - first), at_start_.data() + first);
  }
  find_corrections(step, solver, *rows);
  set_corrections(solver, rows);
}

// Leaves out joints whose motion by the velocities of the step is too far.
void JointCurvature::leave_out_fast(const SteppedJoints& step) {
  const auto is_fast = [&](std::size_t k) {
    const std::size_t j = to_index(step.acting[k]);
    const auto [a, b] = step.ends[j];
    const Joint& joint = step.joints[j];
    return turns_too_far(ends_[a], step.interval.h) || turns_too_far(ends_[b], step.interval.h) ||
           (has_length(joint.kind) &&
            swings_too_far(AnchorPair(joint, step.states[a], step.states[b]),
                           AnchorPair(joint, ends_[a], ends_[b])));
  };
  curved_.erase(std::remove_if(curved_.begin(), curved_.end(), is_fast), curved_.end());
}

// Finds the states of bodies with joints at the end of the step.
void JointCurvature::find_ends(const SteppedJoints& step, const RowSolver& solver) {
  ends_.resize(step.states.size());
  for (const std::size_t k : curved_) {
    const auto [a, b] = step.ends[to_index(step.acting[k])];
    for (const std::size_t body : {a, b})
      ends_[body] = solver.moved(body, step.masses[body], step.states[body]);
  }
}

// Finds the corrections by the errors at the start and by the curvature of the present motion.
void JointCurvature::find_corrections(const SteppedJoints& step, const RowSolver& solver,
                                      const List<Row>& rows) {
  const double h = step.interval.h;
  by_both_ = by_errors_;
  for (const std::size_t k : curved_) {
    const std::size_t j = to_index(step.acting[k]), first = step.first_rows[k];
    const auto [a, b] = step.ends[j];
    const Joint& joint = step.joints[j];
    const int count = static_cast<int>(step.first_rows[k + 1] - first);
    std::array<double, kMostRowsOfJoint> at_end;
    joint_values(joint, ends_[a], ends_[b], step.interval, step.joint_states[j],
                 rows.data() + first, count, at_end.data());
    const double least = kRounded * kEpsilon * size_of(joint, ends_[a], ends_[b]);
    for (std::size_t r = first; r < step.first_rows[k + 1]; ++r) {
      if (!holds_value(rows[r])) continue;
      const double opens = at_end[r - first] - at_start_[r] - h * solver.moving_rate(rows[r], r);
      if (std::abs(opens) > least) by_both_[r] -= opens / h;
    }
  }
}

void JointCurvature::set_corrections(const RowSolver& solver, List<Row>* rows) const {
  for (std::size_t r = 0; r < by_both_.size(); ++r)
    if (starts_[to_index(solver.component(r))] != Start::kKept) (*rows)[r].correction = by_both_[r];
}

// Finds the components in which a correction changes by more than `least` [m/s]. Where changes do
// not fall to half, they would not end: those components begin anew with corrections by errors, and
// keep them.
void JointCurvature::find_changes(double least, const RowSolver& solver, const List<Row>& rows) {
  changes_.assign(starts_.size(), 0.0);
  for (std::size_t r = 0; r < by_both_.size(); ++r) {
    double& change = changes_[to_index(solver.component(r))];
    change = std::max(change, std::abs(by_both_[r] - rows[r].correction));
  }
  for (std::size_t component = 0; component < starts_.size(); ++component) {
    Start& start = starts_[component];
    if (start == Start::kKept) continue;
    double& last = last_changes_[component];
    const double now = changes_[component];
    const bool converges = now <= kLargestRatio * last;
    if (start == Start::kAnew || now <= least)
      start = Start::kKept;
    else
      start = converges ? Start::kAgain : Start::kAnew;
    last = converges ? now : 0.0;
  }
  for (std::size_t r = 0; r < by_both_.size(); ++r)
    if (last_changes_[to_index(solver.component(r))] == 0.0) by_both_[r] = by_errors_[r];
}

// Repeats begin() for velocities and corrections in each component where a correction changes by
// more than `least` [m/s]. Returns whether there is any.
bool JointCurvature::repeat(const SteppedJoints& step, double least, const RowSolver& solver,
                            List<Row>* rows) {
  find_ends(step, solver);
  find_corrections(step, solver, *rows);
  find_changes(least, solver, *rows);
  if (std::all_of(starts_.begin(), starts_.end(),
                  [](Start start) { return start == Start::kKept; }))
    return false;
  set_corrections(solver, rows);
  return true;
}

}  // namespace constraint_sim::engine
