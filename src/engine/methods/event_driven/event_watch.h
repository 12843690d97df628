#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <optional>
#include <tuple>

#include "engine/constraints/one_sided_law.h"
#include "engine/math/embedded_pairs.h"
#include "engine/math/first_root.h"
#include "engine/math/list.h"
#include "engine/math/numbers.h"

namespace constraint_sim::engine {

// Location of the first event in a substep, where a watched value falls below zero. Shared by all
// methods that advance from event to event.

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

/// A substep, whose stages show how forces change between its ends.
class StagedSubstep {
 public:
  StagedSubstep() = default;  ///< no substep: no stage is known
  /// Substep of length h [s] by the pair of this order.
  StagedSubstep(double h, int order) : h_(h), is_of_order_8_(order == 8) {}

  /// Time from a stage to the end [s]. Stage 0 is the derivative at the end, with which the next
  /// substep starts.
  double until_end(std::size_t stage) const { return stage == 0 ? 0.0 : h_ * (1.0 - c(stage)); }
  /// Share of the substep at which a margin(stage) was below −tolerance: at a stage, or at the
  /// lowest point of a parabola through three of them; 0: nowhere. `at_end`: margin at the end.
  template <class Margin>
  double early_below(const Margin& margin, double at_end, double tolerance) const {
    if (h_ == 0.0) return 0.0;
    // Stages in order of time, between which margins are nearly parabolas.
    return is_of_order_8_ ? early_below(margin, at_end, tolerance, std::array{3, 5, 9, 10})
                          : early_below(margin, at_end, tolerance, std::array{1, 2, 3});
  }

 private:
  double c(std::size_t stage) const {
    return is_of_order_8_ ? DormandPrince8::kC[stage] : DormandPrince5::kC[stage];
  }
  template <class Margin, std::size_t n>
  double early_below(const Margin& margin, double at_end, double tolerance,
                     const std::array<int, n>& places) const {
    // A margin that changes by less than a quarter of itself between three places stays above zero.
    constexpr double kQuiet = 4.0;
    const auto [least, most] = std::minmax({margin(places[1]), margin(places[2]), at_end});
    if (least > kQuiet * (most - least) && least > 0.0) return 0.0;
    const std::size_t stages = is_of_order_8_ ? DormandPrince8::kStages : DormandPrince5::kStages;
    std::array<double, DormandPrince8::kStages> of_stage{};
    for (std::size_t i = 1; i < stages; ++i) {
      of_stage[i] = margin(i);
      if (of_stage[i] < -tolerance) return c(i);
    }
    struct Sample {
      double share, value;
    };
    std::array<Sample, n + 1> samples;
    for (std::size_t k = 0; k < n; ++k) {
      const auto i = static_cast<std::size_t>(places[k]);
      samples[k] = {c(i), of_stage[i]};
    }
    samples[n] = {1.0, at_end};
    for (std::size_t k = 0; k + 1 < n; ++k) {
      const auto& [l, m, r] = std::tie(samples[k], samples[k + 1], samples[k + 2]);
      if (m.value > std::min(l.value, r.value)) continue;
      const double fall = (m.value - l.value) / (m.share - l.share);
      const double rise = (r.value - m.value) / (r.share - m.share);
      const double bend = (rise - fall) / (r.share - l.share);
      if (!(bend > 0.0)) continue;
      const double slope = fall + bend * (m.share - l.share);  // at the middle sample
      if (m.value - 0.25 * slope * slope / bend < -tolerance) return m.share - 0.5 * slope / bend;
    }
    return 0.0;
  }

  double h_ = 0.0;
  bool is_of_order_8_ = true;
};

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
inline constexpr int kMostDoubled = 10;  // events without a change that widen a tolerance
// Repetitions before crossings of interpolants alone do not count.
inline constexpr int kMostUnpassed = 12;

/// Level whose crossing is the event, from the start of the substep. The event of a force is just
/// beyond its bound, so that a force that stays at the bound has none; a force that starts there
/// may exceed the bound by its tolerance. A gap or rate that starts at zero and at rest may fall by
/// `touching` or `resting` below its start, which rounding may have put below zero. The same holds
/// after an event that changed nothing. `unchanged`: such events in a row; the value is then less
/// certain than its tolerance, which counts twice as much after each further one. A value that
/// starts below zero and rises has its event where it is back at its start.
inline double level_of(const WatchedValue& start, int unchanged) {
  const double below = std::min(start.value, 0.0);
  const bool is_muted = unchanged > 0;
  const double factor = is_muted ? std::ldexp(1.0, std::min(unchanged, kMostDoubled) - 1) : 1.0;
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

/// Values watched in one substep. Watched is derived from WatchedValue.
template <class Watched>
struct WatchedSubstep {
  List<Watched> before, after;  ///< values at both ends of the substep
  List<int> unchanged;          ///< events in a row that changed nothing, per value; may be shorter

  double level(std::size_t k) const {
    return event_watch::level_of(before[k], k < unchanged.size() ? unchanged[k] : 0);
  }

  /// First event that is expected.
  ExpectedEvent expected() const {
    ExpectedEvent first{kInfinity, 0};
    for (std::size_t k = 0; k < before.size(); ++k) {
      const double time = event_watch::time_to_level(before[k], level(k));
      if (time < first.time) first = {time, k};
    }
    return first;
  }

  /// Earliest crossing of the interpolants between two places, h apart [s]. `is_all`: the places
  /// are both ends of the substep.
  std::optional<Crossing> earliest(const List<Watched>& from, const List<Watched>& to, double h,
                                   bool is_all) const {
    std::optional<Crossing> first;
    for (std::size_t k = 0; k < from.size(); ++k) {
      std::optional<double> root = event_watch::first_crossing(from[k], to[k], h, level(k), is_all);
      if (!root && is_all && to[k].early > 0.0) root = to[k].early;
      if (root && (!first || *root < first->share)) first = Crossing{*root, k};
    }
    return first;
  }

  /// First value that is beyond its event at `after`. A value that starts below its level counts
  /// only where it falls.
  std::optional<std::size_t> find_passed(double least, bool is_rough) const {
    for (std::size_t k = 0; k < after.size(); ++k) {
      const Watched& there = after[k];
      const double at = level(k);
      if (there.value < at - event_watch::slack_of(there, least, is_rough) &&
          (there.known == 0 || before[k].value >= at || there.rate < 0.0))
        return k;
    }
    return std::nullopt;
  }

  /// Whether the event of value k is at `after`.
  bool is_there(std::size_t k, double least, bool is_rough) const {
    const Watched& there = after[k];
    return (there.known == 0 || there.rate < 0.0 || (is_rough && there.rough > 0.0)) &&
           std::abs(there.value - level(k)) <= event_watch::slack_of(there, least, is_rough);
  }

  /// Event at the end of a substep of length h from t [s], if there is one to rounding. `crossing`:
  /// the earliest one; `expected`: event at which the substep was to end.
  std::optional<Crossing> at_end(double t, double h, const std::optional<Crossing>& crossing,
                                 const std::optional<ExpectedEvent>& expected) const {
    constexpr double kRounding = 4.0;  // of a time that is found from a value and its derivatives
    const double least = kRounding * event_watch::kLocatedTime * std::max(1.0, std::abs(t));
    if (crossing ? (1.0 - crossing->share) * h > least : !expected) return std::nullopt;
    const std::size_t which = crossing ? crossing->which : expected->which;
    if (find_passed(least, false) || !is_there(which, least, false)) return std::nullopt;
    return Crossing{1.0, which};
  }

  /// Shortens the substep, which started at t with length h, to end at the first event; `after`
  /// then holds the values there. Keeps the whole substep where there is no event. `go_to(share,
  /// is_start)` repeats the substep up to `share`, or only returns to its start, and sets `after`;
  /// returns false where that fails. Returns false also where no event is found.
  template <class GoTo>
  bool locate(double t, double h, GoTo go_to_share, std::optional<Crossing>* event) {
    using namespace event_watch;  // NOLINT(google-build-using-namespace): its constants
    const double least = kLocatedTime * std::max(1.0, std::abs(t));
    double low = 0.0, high = 1.0, here = 1.0;
    bool is_passed = find_passed(least, false).has_value();
    if (!is_passed && (1.0 - (*event)->share) * h <= least &&
        is_there((*event)->which, least, false))
      return true;
    int low_for = 0, high_for = 0;  // consecutive moves of the other end
    low_ = before;
    high_ = after;
    const auto go_to = [&](double share) {
      here = share;
      return go_to_share(share, share * h <= least);
    };
    for (int i = 0; i < kMostLocations; ++i) {
      const bool is_rough = i >= kMostSmooth;
      if (is_passed && (high - low) * h <= 2.0 * least) {
        if (here != high && !go_to(high)) return false;
        const std::optional<std::size_t> passed = find_passed(least, is_rough);
        if (passed)
          *event = Crossing{high, *passed};
        else  // the first try crossed by rounding only
          event->reset();
        return true;
      }
      const std::optional<Crossing> next =
          i == 0 ? *event : earliest(low_, high_, (high - low) * h, false);
      if (!is_passed && (!next || i >= kMostUnpassed)) {  // the crossing is within rounding
        event->reset();
        return here == high || go_to(high);
      }
      const bool by_model = i < kMostNewton && next && (i == 0 || low == 0.0 || next->share > 0.0);
      const double share = low + (by_model ? next->share : 0.5) * (high - low);
      if (!go_to(share)) return false;
      if (next) *event = next;
      const std::optional<std::size_t> passed = find_passed(least, is_rough);
      if (share * h <= least || (!passed && is_there((*event)->which, least, is_rough)))
        return true;
      if (passed) {
        high = share;
        high_ = after;
        is_passed = true;
        low_for = 0;
        if (++high_for > 1)
          for (Watched& w : low_)
            if (w.known == 0 && w.value > 0.0) w.value *= 0.5;  // Illinois method
      } else {
        low = share;
        low_ = after;
        high_for = 0;
        if (++low_for > 1)
          for (Watched& w : high_)
            if (w.known == 0 && w.value < -4.0 * w.tolerance) w.value *= 0.5;
      }
    }
    return false;
  }

 private:
  List<Watched> low_, high_;
};

}  // namespace constraint_sim::engine
