#pragma once

#include <algorithm>

#include "engine/collision/contact_tolerances.h"
#include "engine/math/numbers.h"

namespace constraint_sim::engine {

/// Closing rule for events that follow each other without end at speeds that no longer matter:
/// corners that rattle ever lower, slips that turn at their end again and again. Where a step has
/// many such events, the speeds that count as zero are doubled, until contacts rest and stick.
class Rattling {
 public:
  void begin_step() {
    left_ = kMostEvents;
    last_ = -kInfinity;
  }
  /// Notes an event at time t [s] of a contact with this speed [m/s]. Returns the speed up to which
  /// speeds are to count as zero.
  double zero_speed(double t, double speed, const ContactTolerances& within) {
    const bool is_soon = t - last_ <= kSoon;
    last_ = t;
    if (!is_soon || speed > within.rattling || --left_ > 0) return within.resting;
    left_ = kNextEvents;
    return std::min(2.0 * within.resting, within.rattling);
  }
  /// Whether speeds cannot be doubled any more.
  static bool is_closed(const ContactTolerances& within) {
    return within.resting >= within.rattling;
  }

 private:
  static constexpr double kSoon = 1e-5;  // [s]
  static constexpr int kMostEvents = 20, kNextEvents = 4;

  int left_ = kMostEvents;  // events until speeds are doubled
  double last_ = -kInfinity;
};

}  // namespace constraint_sim::engine
