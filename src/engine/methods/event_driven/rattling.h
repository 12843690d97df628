#pragma once

#include <algorithm>

#include "engine/math/numbers.h"

namespace constraint_sim::engine {

/// Closing rule for events that follow each other without end at speeds that no longer matter:
/// corners and limits that rattle ever lower, boxes that rock to rest, slips that turn at their end
/// again and again. Where a step has many events in a row, the speeds that count as zero double at
/// each further one, until contacts and limits rest and slips stick.
class Rattling {
 public:
  /// Speed of events of laws that need not be followed [m/s or rad/s]. Under an acceleration of 1e3
  /// a limit throws a coordinate off by 5e-14 at this speed, little more than rounding.
  static constexpr double kMostOfLaws = 1e-5;

  void begin_step() {
    left_ = kMostEvents;
    last_ = -kInfinity;
  }
  /// Notes an event at time t [s] with a speed of approach or slip [m/s or rad/s]. Returns the
  /// speed up to which speeds are to count as zero: `zero` until now, `most` at most.
  double zero_speed(double t, double speed, double zero, double most) {
    const bool is_soon = t - last_ <= kSoon;
    last_ = t;
    if (is_soon && left_ > 0) --left_;
    return is_soon && left_ == 0 && speed <= most ? std::min(2.0 * zero, most) : zero;
  }

 private:
  static constexpr double kSoon = 1e-5;  // [s]
  static constexpr int kMostEvents = 15;

  int left_ = kMostEvents;  // events until speeds grow
  double last_ = -kInfinity;
};

}  // namespace constraint_sim::engine
