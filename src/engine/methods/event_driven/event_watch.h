#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <optional>

#include "engine/constraints/one_sided_law.h"
#include "engine/math/first_root.h"
#include "engine/math/numbers.h"

namespace constraint_sim::engine {

// Watched values, and where they have events. WatchedSubstep locates the first event in a substep
// by these functions. Shared by all methods that advance from event to event.

/// Duration [s] of impacts, in which their force is impulse / duration. Rigid bodies have none;
/// bodies of steel that touch are in contact for longer.
inline constexpr double kImpactDuration = 1e-6;

/// Share of the servo's limit within which a force is at the limit.
inline constexpr double kServoEdge = 1e-9;
/// Time [s] within which a force that reaches the limit is at the limit.
inline constexpr double kServoEdgeTime = 1e-12;

/// Watched value. An event is where `value` falls below zero.
struct WatchedValue {
  double value = 0.0, rate = 0.0, acceleration = 0.0;
  int known = 0;         ///< number of known derivatives
  double tolerance = 0;  ///< rounding of the value, in its unit
  /// Accuracy of events of a value without slope, in the unit of the value.
  double rough = 0.0;
  /// Share of the substep at which a stage was below zero; 0: none.
  double early = 0.0;
  /// Value and rate that count as zero, of a value with one known derivative or two, in its unit.
  double touching = kTouching, resting = kResting;
};

/// Whether a value is beyond doubt above zero.
inline bool is_clear(const WatchedValue& watched) {
  if (watched.known == 0) return watched.value > watched.tolerance;
  return watched.value > (watched.known == 1 ? watched.resting : watched.touching);
}

/// Predicted crossing of zero, as a share of a substep.
struct Crossing {
  double share;
  std::size_t which;
};

/// Event that comes if the last known derivative of its value stays as it is.
struct ExpectedEvent {
  double time;  ///< from the start of the substep [s]; infinite: none
  std::size_t which;
};

namespace event_watch {

inline constexpr double kLocatedForce = 1e-3;  // share of the tolerance of forces
inline constexpr double kLocatedTime = 1e-15;  // [s], and share of the time
inline constexpr int kMostLocations = 120;     // repeated substeps per event
inline constexpr int kMostNewton = 40;         // repetitions by interpolation; further ones bisect
inline constexpr int kMostSmooth = 5;    // repetitions with the tolerance of values with a slope
inline constexpr int kMostDoubled = 9;   // doublings of a tolerance by events without a change
inline constexpr int kDoubledForce = 3;  // doublings of the tolerance of a force by each
// Repetitions before crossings of interpolants alone do not count.
inline constexpr int kMostUnpassed = 12;

/// Level whose crossing is the event, from the start of the substep. The event of a force is just
/// beyond its bound, so that a force that stays at the bound has none; a force that starts there
/// may exceed the bound by its tolerance. A gap or rate that starts at zero and at rest may fall by
/// `touching` or `resting` below its start, which rounding may have put below zero. The same holds
/// after an event that changed nothing. `unchanged`: such events in a row; the value is then less
/// certain than its tolerance, which counts twice as much after each further one, and eight times
/// for a force. A value that starts below zero and rises has its event where it is back at its
/// start.
inline double level_of(const WatchedValue& start, int unchanged) {
  const double below = std::min(start.value, 0.0);
  const bool is_muted = unchanged > 0;
  const int doublings = (unchanged - 1) * (start.known == 0 ? kDoubledForce : 1);
  const double factor = is_muted ? std::ldexp(1.0, std::min(doublings, kMostDoubled)) : 1.0;
  if (start.known == 0) {
    if (is_muted) return below - factor * start.tolerance;
    return (start.value > start.tolerance ? -kLocatedForce : -1.0) * start.tolerance;
  }
  const double least = start.known == 1 ? start.resting : start.touching;
  if (!is_muted && start.value < 0.0 && start.rate > start.resting) return start.value;
  if (!is_muted && (start.value > least || std::abs(start.rate) > start.resting)) return 0.0;
  return below - factor * least;
}

/// Tolerated distance of a value from its level at an event, where times are resolved to `least`
/// [s]. `is_rough`: the value seems to have no slope, as at the end of a slip that turns ever
/// faster.
inline double slack_of(const WatchedValue& there, double least, bool is_rough) {
  if (there.known == 0) return 0.5 * kLocatedForce * there.tolerance;
  return std::max({there.tolerance, -least * there.rate, is_rough ? there.rough : 0.0});
}

/// First crossing of `level` by the interpolant of a value over an interval h, as a share of the
/// interval. `is_all`: the interval is the whole substep.
inline std::optional<double> first_crossing(const WatchedValue& from, const WatchedValue& to,
                                            double h, double level, bool is_all) {
  const double p0 = from.value - level, p1 = to.value - level;
  if (from.known == 0) {
    if (!(to.value < (is_all ? std::min(level, -to.tolerance) : level))) return std::nullopt;
    return std::clamp(p0 / (p0 - p1), 0.0, 1.0);
  }
  const auto root_of = [&](auto p) {
    const bool is_leaving = p[0] <= 0.0 && from.rate > 0.0;
    p[0] = is_leaving ? 0.0 : std::max(p[0], 0.0);
    return is_leaving ? first_root_after_zero(p) : first_root(p);
  };
  const double v0 = h * from.rate, v1 = h * to.rate;
  if (from.known == 1) return root_of(Bernstein<4>{p0, p0 + v0 / 3.0, p1 - v1 / 3.0, p1});
  const double a0 = h * h * from.acceleration, a1 = h * h * to.acceleration;
  return root_of(Bernstein<6>{p0, p0 + v0 / 5.0, p0 + 2.0 * v0 / 5.0 + a0 / 20.0,
                              p1 - 2.0 * v1 / 5.0 + a1 / 20.0, p1 - v1 / 5.0, p1});
}

/// Time until a value reaches its level if its last known derivative stays as it is [s]; infinite
/// where it does not, or where no derivative is known. A value that leaves its level returns to it.
inline double time_to_level(const WatchedValue& start, double level) {
  const double p = start.value - level, v = start.rate, a = start.acceleration;
  if (start.known == 0) return kInfinity;
  if (start.known == 1) return p > 0.0 && v < 0.0 ? -p / v : kInfinity;
  if (p <= 0.0) return v > 0.0 && a < 0.0 ? -2.0 * v / a : kInfinity;
  const double square = v * v - 2.0 * a * p;
  if (square < 0.0 || (v >= 0.0 && a >= 0.0)) return kInfinity;
  const double root = std::sqrt(square);
  return v < 0.0 ? 2.0 * p / (root - v) : (v + root) / -a;
}

}  // namespace event_watch
}  // namespace constraint_sim::engine
