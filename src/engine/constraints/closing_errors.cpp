#include "engine/constraints/closing_errors.h"

#include <cmath>

#include "engine/constraints/law.h"
#include "engine/math/numbers.h"

namespace constraint_sim::engine {
namespace {

constexpr double kNoMotion = 1e-9;            // [m] less motion in closing_time is none
constexpr double kLeastShareOfClosing = 0.5;  // shortest duration as a share of closing_time

}  // namespace

MotionBefore motion_before(const Joint& joint, const JointData& state, int coordinate, double t,
                           double closing_time) {
  const CoordinateLaw& law = joint.coordinates[to_index(coordinate)];
  const CoordinateState& now = state.coordinates[to_index(coordinate)];
  const bool is_lost = may_lose_motion(law) && (now.braking > 0.0 || state.saturated);
  if (!law.motor || !law.motor->is_rigid() || !law.motor->position || is_lost)
    return {now.velocity, 0.0, kInfinity};
  const Prescribed error =
      closing_errors(joint, state, t, closing_time).of(forms(joint.kind).rows + coordinate);
  const MovingStart& moving = state.to_close.moving[to_index(coordinate)];
  const double end =
      moving.duration > 0.0 ? moving.since + moving.duration : state.to_close.since + closing_time;
  return {error.rate, error.acceleration, end - t};
}

void send_coordinate(const Joint& joint, int coordinate, const MotionBefore& before, double t,
                     double closing_time, JointData& state) {
  const JointForms& kind = forms(joint.kind);
  const CoordinateState& now = state.coordinates[to_index(coordinate)];
  const double off = now.position - now.held;
  MovingStart& moving = state.to_close.moving[to_index(coordinate)];
  moving = {};
  const double metres = kind.coordinate[to_index(coordinate)].is_angle ? state.radius : 1.0;
  const double displacement =
      closing_time * std::max(std::abs(before.rate), closing_time * std::abs(before.acceleration));
  const bool is_moving = metres * displacement > kNoMotion;
  state.to_close.offset[kind.rows + coordinate] = off;
  if (!is_moving && state.to_close.since == t) return;  // closes with the joint
  state.closing = true;
  moving = {t, closing_time, off, 0.0, 0.0};
  if (!is_moving) return;
  moving.rate = before.rate;
  moving.acceleration = before.acceleration;
  moving.duration = duration_without_overshoot(
      moving, std::min(kLeastShareOfClosing * closing_time, before.left), closing_time);
}

}  // namespace constraint_sim::engine
