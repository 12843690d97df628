#pragma once

#include <algorithm>
#include <limits>
#include <tuple>

#include "constraint_sim/engine/joint.h"
#include "engine/constraints/joint_kinds.h"
#include "engine/constraints/prescribed.h"
#include "engine/math/list.h"
#include "engine/model/joint_data.h"

namespace constraint_sim::engine {

/// Largest error of a joint that counts as closed [m], [rad] for angles: above what methods and
/// rounding leave (1e-9), and below what shows. Reports leave out smaller errors.
inline constexpr double kClosedError = 1e-6;

/// Prescribed errors of a closing joint at one time. Each error goes from its start in
/// ErrorsToClose to zero. Refers to the errors that it is made from.
class ClosingErrors {
 public:
  /// Prescribes no errors.
  ClosingErrors() = default;
  /// `rows`: number of rows, which precede the coordinates.
  ClosingErrors(const ErrorsToClose& start, int rows, double t, double closing_time)
      : start_(&start), rows_(rows), t_(t), share_(closing_motion(t - start.since, closing_time)) {}

  /// Returns the error of a row or coordinate; `function` is its index in JointForms::function.
  Prescribed of(int function) const {
    if (start_ == nullptr) return {};
    if (function >= rows_) {
      const MovingStart& moving = start_->moving[to_index(function - rows_)];
      if (moving.duration > 0.0) return moving_error(moving, t_ - moving.since);
    }
    return part(start_->offset[function]);
  }
  Prescribed coupling() const {
    return start_ == nullptr || start_->coupling == 0.0 ? Prescribed{} : part(start_->coupling);
  }
  /// Returns what is left of an error of a limit, `beyond` at the start of the motion of its
  /// coordinate [m or rad].
  Prescribed of_limit(int function, double beyond) const {
    if (start_ == nullptr || beyond == 0.0) return {};
    const MovingStart& moving = start_->moving[to_index(function - rows_)];
    if (!(moving.duration > 0.0)) return part(beyond);
    return moving_error({moving.since, moving.duration, beyond, 0.0, 0.0}, t_ - moving.since);
  }
  /// Remaining share of the shift and the turn of the frame on B.
  const Prescribed& share() const { return share_; }

 private:
  Prescribed part(double offset) const {
    return {offset * share_.value, offset * share_.rate, offset * share_.acceleration};
  }

  const ErrorsToClose* start_ = nullptr;
  int rows_ = 0;
  double t_ = 0.0;
  Prescribed share_;
};

/// Returns the errors of a joint at time t; none where it does not close, or closes by a share per
/// step.
inline ClosingErrors closing_errors(const Joint& joint, const JointData& state, double t,
                                    double closing_time) {
  if (!state.closing || closing_time == 0.0) return {};
  return {state.to_close, forms(joint.kind).rows, t, closing_time};
}

/// Calls `visit(since)` for each time at which errors began to be closed.
template <class Errors, class Visit>
void visit_starts(Errors& errors, Visit visit) {
  visit(errors.since);
  for (auto& moving : errors.moving)
    if (moving.duration > 0.0) visit(moving.since);
}

/// Calls `visit(end)` for each time at which errors are closed [s].
template <class Visit>
void visit_ends(const ErrorsToClose& errors, double closing_time, Visit visit) {
  visit(errors.since + closing_time);
  for (const MovingStart& moving : errors.moving)
    if (moving.duration > 0.0) visit(moving.since + moving.duration);
}

/// Returns the time at which all errors are closed [s].
inline double end_of_closing(const ErrorsToClose& errors, double closing_time) {
  double last = errors.since + closing_time;
  visit_ends(errors, closing_time, [&](double end) { last = std::max(last, end); });
  return last;
}

/// Whether a joint that closes errors has begun before time t, so that other errors go on closing
/// when a motor gets a new position.
inline bool goes_on_closing(const JointData& state, double t, double closing_time) {
  if (!state.closing || closing_time == 0.0) return false;
  bool has_begun = false;
  visit_starts(state.to_close, [&](double since) { has_begun = has_begun || since < t; });
  return has_begun;
}

/// Motion of a coordinate when its motor gets a new position.
struct MotionBefore {
  double rate = 0.0;          ///< [m/s or rad/s]
  double acceleration = 0.0;  ///< [m/s² or rad/s²]
  /// Time that the prescribed motion still takes [s]; infinite where there is none.
  double left = std::numeric_limits<double>::infinity();
};

/// Returns the motion of a coordinate: as prescribed by a position motor that has not lost its
/// motion, or else the actual rate. `state` is measured with the joint as it is before the edit.
MotionBefore motion_before(const Joint& joint, const JointData& state, int coordinate, double t,
                           double closing_time);

/// Sends a coordinate to the position of its motor, with the motion that it has. The joint was
/// measured, and begun where it did not close. The coordinate arrives after closing_time, or
/// earlier where it would go beyond the position and return: after half of closing_time at least,
/// or at the end of the motion before.
void send_coordinate(const Joint& joint, int coordinate, const MotionBefore& before, double t,
                     double closing_time, JointData& state);

/// Exact equality, number by number.
inline bool are_same(const ErrorsToClose& a, const ErrorsToClose& b) {
  const auto is_same_motion = [](const MovingStart& a, const MovingStart& b) {
    return std::tie(a.since, a.duration, a.offset, a.rate, a.acceleration) ==
           std::tie(b.since, b.duration, b.offset, b.rate, b.acceleration);
  };
  return std::equal(a.moving.begin(), a.moving.end(), b.moving.begin(), is_same_motion) &&
         std::tie(a.since, a.offset, a.shift, a.turn, a.coupling) ==
             std::tie(b.since, b.offset, b.shift, b.turn, b.coupling);
}

}  // namespace constraint_sim::engine
