#pragma once

#include <cmath>

#include "engine/constraints/one_sided_law.h"
#include "engine/constraints/prescribed.h"
#include "engine/math/numbers.h"
#include "engine/methods/event_driven/event_watch.h"

namespace constraint_sim::engine {

// Watched values and states of springs that only pull. With the stretch x = q − R, the law is the
// tension T = K x + C ẋ where x > 0 and T > 0, and else no force. T jumps where the rope becomes
// taut and has a damper; it is continuous where the rope slackens.

/// Unit of the force of a spring that only pulls: the force of 1 m of stretch, or of 1 m/s where
/// there is only a damper [N].
inline double unit_of_tension(const OneSidedLaw& law) {
  return law.servo.K > 0.0 ? law.servo.K : law.servo.C;
}

/// Adds the stretch of a slack spring that only pulls until it is stretched, or its tension until
/// it begins or ceases to pull.
template <class Reading, class Add>
void watch_tension(const OneSidedLaw& law, const OneSidedState& state, const Reading& reading,
                   const Prescribed& rest, Add add) {
  const double unit = unit_of_tension(law);
  const double positions = std::abs(reading.q) + std::abs(rest.value);
  WatchedValue stretch;
  stretch.known = 2;
  stretch.value = reading.q - rest.value;
  stretch.rate = reading.rate - rest.rate;
  stretch.acceleration = reading.acceleration - rest.acceleration;
  stretch.tolerance = 4.0 * kEpsilon * positions;
  WatchedValue tension = stretch;
  if (law.servo.C > 0.0) {
    tension.known = 1;
    tension.value = -servo_force(law, reading, rest) / unit;
    tension.rate = -servo_force_rate(law, reading, rest) / unit;
    tension.tolerance =
        4.0 * kEpsilon / unit *
        (law.servo.K * positions + law.servo.C * (std::abs(reading.rate) + std::abs(rest.rate)));
  }
  const auto opposite = [](WatchedValue value) {
    value.value = -value.value;
    value.rate = -value.rate;
    value.acceleration = -value.acceleration;
    return value;
  };
  if (state.servo == Servo::kFollows) add(tension);
  if (state.servo == Servo::kSlack) add(opposite(stretch));
  if (state.servo != Servo::kRetracts) return;
  add(opposite(tension));
  add(stretch);
}

/// State of a spring that only pulls, from now on. At the natural length its rate decides, and at
/// rest its acceleration; where the tension is zero, the rate of the tension.
template <class Reading>
Servo tension_from(const OneSidedLaw& law, Servo before, const Reading& reading,
                   const Prescribed& rest) {
  const double stretch = reading.q - rest.value;
  const double rate = reading.rate - rest.rate;
  if (stretch < -kTouching) return Servo::kSlack;
  if (stretch <= kTouching) {
    const double leaves =
        std::abs(rate) > kResting ? rate : reading.acceleration - rest.acceleration;
    if (leaves == 0.0) return before == Servo::kFollows ? Servo::kFollows : Servo::kSlack;
    return leaves > 0.0 ? Servo::kFollows : Servo::kSlack;
  }
  const double unit = unit_of_tension(law);
  const double tension = -servo_force(law, reading, rest) / unit;
  const double tension_rate = -servo_force_rate(law, reading, rest) / unit;
  const double edge = kServoEdge + kServoEdgeTime * std::abs(tension_rate);
  if (std::abs(tension) > edge) return tension > 0.0 ? Servo::kFollows : Servo::kRetracts;
  if (tension_rate != 0.0) return tension_rate > 0.0 ? Servo::kFollows : Servo::kRetracts;
  return before == Servo::kFollows ? Servo::kFollows : Servo::kRetracts;
}

}  // namespace constraint_sim::engine
