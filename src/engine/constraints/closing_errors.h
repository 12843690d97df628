#pragma once

#include <tuple>

#include "constraint_sim/engine/joint.h"
#include "engine/constraints/course.h"

namespace constraint_sim::engine {

/// Prescribed errors of a closing joint at one time. Each error goes from its value in
/// ErrorsToClose to zero. Refers to the errors that it is made from.
class ClosingErrors {
 public:
  /// Prescribes no errors.
  ClosingErrors() = default;
  ClosingErrors(const ErrorsToClose& start, double t, double closing_time)
      : start_(&start), share_(closing_course(t - start.since, closing_time)) {}

  /// Returns the error of a row or coordinate; `function` is its index in JointKindInfo::function.
  Prescribed of(int function) const {
    return start_ == nullptr ? Prescribed{} : part(start_->offset[function]);
  }
  Prescribed coupling() const {
    return start_ == nullptr || start_->coupling == 0.0 ? Prescribed{} : part(start_->coupling);
  }
  /// Remaining share of the shift and the turn of the frame on B.
  const Prescribed& share() const { return share_; }

 private:
  Prescribed part(double offset) const {
    return {offset * share_.value, offset * share_.rate, offset * share_.acceleration};
  }

  const ErrorsToClose* start_ = nullptr;
  Prescribed share_;
};

/// Returns the errors of a joint at time t; none where it does not close, or closes by a share per
/// step.
inline ClosingErrors closing_errors(const JointState& state, double t, double closing_time) {
  if (!state.closing || closing_time == 0.0) return {};
  return {state.to_close, t, closing_time};
}

/// Returns the time at which all errors are closed [s].
inline double end_of_closing(const ErrorsToClose& start, double closing_time) {
  return start.since + closing_time;
}

/// Exact equality, number by number.
inline bool are_same(const ErrorsToClose& a, const ErrorsToClose& b) {
  return std::tie(a.since, a.offset, a.shift, a.turn, a.coupling) ==
         std::tie(b.since, b.offset, b.shift, b.turn, b.coupling);
}

}  // namespace constraint_sim::engine
