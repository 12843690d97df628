#pragma once

#include <cmath>

#include "engine/constraints/one_sided_law.h"
#include "engine/constraints/prescribed.h"
#include "engine/methods/event_driven/event_watch.h"

namespace constraint_sim::engine {

// Motors that have a position and a force limit, and follow a prescribed motion to the position
// until they lose it. A reading has position `q` and `rate` of the coordinate.

/// Judges whether a motor follows its motion, `prescribed`, and sets its deceleration: 0
/// where it does, `braking_of()` where it has just lost the motion. A motor that arrived before the
/// motion that it had lost ends the motion by `end_motion()`.
template <class Reading, class BrakingOf, class EndMotion>
void judge_motion(const Reading& now, const Prescribed& prescribed, double goal,
                  BrakingOf braking_of, EndMotion end_motion, double* braking) {
  const auto follows = [&](const Prescribed& motion) {
    return std::abs(now.q - motion.value) <= kTouching &&
           std::abs(now.rate - motion.rate) <= kResting;
  };
  if (follows(prescribed)) {
    *braking = 0.0;
  } else if (*braking == 0.0) {
    *braking = braking_of();
  } else if (follows({goal, 0.0, 0.0})) {
    *braking = 0.0;
    end_motion();
  }
}

/// Whether a coordinate at a limit, with an acceleration by the full force of its motor, presses
/// against the limit. `limit(upper_one)`: position and motion of a limit.
template <class Limit>
bool is_pressed(const OneSidedLaw& law, double q, double acceleration, Limit limit) {
  for (const bool upper_one : {false, true}) {
    if (!std::isfinite(law.limit(upper_one))) continue;
    const Prescribed at_limit = limit(upper_one);
    const double direction = upper_one ? -1.0 : 1.0;
    if (direction * (q - at_limit.value) <= kTouching &&
        direction * (acceleration - at_limit.acceleration) < 0.0)
      return true;
  }
  return false;
}

}  // namespace constraint_sim::engine
