#include "engine/constraints/prescribed_motion.h"

#include <algorithm>

#include "engine/constraints/distance.h"
#include "engine/constraints/joint_kinds.h"
#include "engine/constraints/law.h"
#include "engine/constraints/prescribed.h"
#include "engine/math/list.h"

namespace constraint_sim::engine {

MotorRate drive(const DistanceJoint& distance, const JointStep& step, const Motor& motor,
                JointState& state) {
  MotorRate rate = motor_rate(motor);
  state.saturated = false;
  state.bias = 0.0;
  // The bias acts until it expires, so that the travel does not depend on the tick.
  rate.bias *= std::clamp((state.expires_at - step.t) / step.h, 0.0, 1.0);
  if (!rate.is_moving()) return rate;
  double travel = motor_travel(rate, step.t, step.h);
  const double lowest = least_travel(distance);
  if (state.travel + travel < lowest) {
    travel = std::min(lowest - state.travel, 0.0);
    state.saturated = true;
    rate = MotorRate{};
    rate.bias = travel / step.h;
  }
  state.bias = travel / step.h;
  return rate;
}

MotorRate drive(const CoordinateLaw& law, const JointStep& step, CoordinateState* state) {
  state->bias = 0.0;
  if (law.motor->position) {
    state->held = *law.motor->position;
    return {};
  }
  MotorRate rate = motor_rate(*law.motor);
  if (!rate.is_moving()) return rate;
  if (law.motor->timeout > 0.0)
    rate.bias *= std::clamp((state->expires_at - step.t) / step.h, 0.0, 1.0);
  if (rate.is_moving()) state->bias = motor_travel(rate, step.t, step.h) / step.h;
  return rate;
}

void PrescribedMotion::begin(const Joint& joint, const JointStep& step, JointData& state) {
  if (is_closing()) *this = PrescribedMotion{};
  const JointForms& kind = forms(joint.kind);
  start_ = step.t;
  is_driven_ = false;
  rows_ = kind.rows;
  count_ = to_index(kind.coordinates);
  if (const auto* distance = if_distance(joint)) {
    count_ = 1;
    rows_ = 0;
    const MotorRate motor = drive(*distance, step, joint.motor, state);
    hold(0, distance->length.value_or(0.0) + state.travel, motor);
  }
  for (std::size_t i = 0; i < to_index(kind.coordinates); ++i) {
    CoordinateState& coordinate = state.coordinates[i];
    coordinate.bias = 0.0;
    held_[i] = Held{};
    const CoordinateLaw& law = joint.coordinates[i];
    if (!law.motor || !law.motor->is_rigid()) continue;
    const MotorRate motor = drive(law, step, &coordinate);
    if (!is_held(law)) continue;  // a motor with a force limit prescribes nothing
    hold(i, coordinate.held - joint.coordinates[i].zero, motor);
  }
  if (kind.coordinates > 0) state.bias = state.coordinates[0].bias;
  if (!state.closing) return;
  to_close_ = state.to_close;
  closing_time_ = step.closing_time;
  moves_frame_ = kind.alignment != Alignment::kFree || !to_close_.shift.isZero(0.0);
}

void PrescribedMotion::hold(std::size_t i, double value, const MotorRate& motor) {
  held_[i] = {value, motor, 0.0, 0.0, {}};
  if (motor.amplitude != 0.0) held_[i].phase = motor_phase(motor, start_);
  is_driven_ = is_driven_ || motor.is_moving();
}

Prescribed PrescribedMotion::length(double t) const {
  Prescribed length = moved(held_[0], t);
  length.value += held_[0].value;
  if (!is_closing()) return length;
  const Prescribed error = closing(t).of(0);
  length.value += error.value;
  length.rate += error.rate;
  length.acceleration += error.acceleration;
  return length;
}

Prescribed PrescribedMotion::target(int function, double t) const {
  Prescribed target = closing(t).of(function);
  if (function < rows_) return target;
  const Held& held = held_[function - rows_];
  const Prescribed driven = moved(held, t);
  target.value += held.value + driven.value;
  target.rate += driven.rate;
  target.acceleration += driven.acceleration;
  return target;
}

void finish_interval(const Joint& joint, const JointStep& step, JointData& state) {
  if (has_length(joint.kind)) {
    state.travel += state.bias * step.h;
    return;
  }
  for (CoordinateState& coordinate : state.coordinates) coordinate.held += coordinate.bias * step.h;
}

void set_mean_rates(const Joint& joint, const JointStep& step, const JointData& before,
                    JointData& state) {
  if (const auto* distance = if_distance(joint)) {
    JointData whole = before;
    drive(*distance, step, joint.motor, whole);
    state.bias = whole.bias;
    return;
  }
  for (std::size_t i = 0; i < to_index(forms(joint.kind).coordinates); ++i) {
    const CoordinateLaw& law = joint.coordinates[i];
    if (!law.motor || !law.motor->is_rigid()) continue;
    CoordinateState whole = before.coordinates[i];
    drive(law, step, &whole);
    state.coordinates[i].bias = whole.bias;
  }
  state.bias = state.coordinates[0].bias;
}

}  // namespace constraint_sim::engine
