#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <limits>
#include <optional>
#include <vector>

#include "engine/methods/first_root.h"

namespace constraint_sim::engine {

// Where in a substep the first event is, of values that are watched: at an event one of them falls
// below zero. For whatever steps from event to event.

inline constexpr double kTouching = 1e-10;  ///< [m or rad] a gap no larger is closed
inline constexpr double kResting = 1e-9;    ///< [m/s or rad/s] a rate no larger is none

/// What an event waits for: where `value` falls below zero.
struct WatchedValue {
  double value = 0.0, rate = 0.0, acceleration = 0.0;
  int known = 0;         ///< derivatives of the value that are known
  double tolerance = 0;  ///< [that of the value] below which it is rounding
  double early = 0.0;    ///< where a stage of the substep had it below, as a share; 0: none did
};

/// Where something is about to fall below zero, as a share of a substep.
struct Crossing {
  double share;
  std::size_t which;
};

namespace event_watch {

inline constexpr double kLeavesFor = 1e-9;     // of a substep: what comes back before has not left
inline constexpr double kLocatedForce = 1e-3;  // of the tolerance of forces
inline constexpr double kLocated = 1e-15;      // [s], and of the time
inline constexpr int kMostLocations = 80;      // substeps taken again for one event
inline constexpr int kMostNewton = 40;         // of these by models, the others by halves

/// Where a force has its event: just beyond its bound, so that it is told from one that stays; a
/// force that starts there may be beyond by its tolerance.
inline double aim_of(const WatchedValue& start) {
  return (start.value > start.tolerance ? -kLocatedForce : -1.0) * start.tolerance;
}

/// The first root in a substep of h from one end to the other, of what was watched at both and
/// where the substep starts.
inline std::optional<double> first_crossing(const WatchedValue& from, const WatchedValue& to,
                                            double h, const WatchedValue& start, bool is_all) {
  if (from.known == 0) {
    const double aim = aim_of(start);
    if (!(to.value < (is_all ? -to.tolerance : aim))) return std::nullopt;
    return std::clamp((from.value - aim) / (from.value - to.value), 0.0, 1.0);
  }
  const auto root_of = [&](auto p, double resting, bool is_still) -> std::optional<double> {
    const bool is_falling =
        from.rate < -resting || (from.rate < 0.0 && from.value > from.tolerance && !is_still);
    if (from.value > resting || is_falling) {
      p[0] = std::max(p[0], 0.0);
      return first_root(p);
    }
    if (!is_still && from.rate > 0.0) {
      auto from_zero = p;
      from_zero[0] = 0.0;
      const auto root = first_root_after_zero(from_zero);
      if (!root || *root > kLeavesFor) return root;
    }
    const double start = std::min(p[0], 0.0);  // less is what it starts with, or rounding
    for (double& c : p) c += resting - start;
    return first_root(p);
  };
  const double p0 = from.value, p1 = to.value, v0 = h * from.rate, v1 = h * to.rate;
  if (from.known == 1)
    return root_of(Bernstein<4>{p0, p0 + v0 / 3.0, p1 - v1 / 3.0, p1}, kResting, false);
  const double a0 = h * h * from.acceleration, a1 = h * h * to.acceleration;
  return root_of(Bernstein<6>{p0, p0 + v0 / 5.0, p0 + 2.0 * v0 / 5.0 + a0 / 20.0,
                              p1 - 2.0 * v1 / 5.0 + a1 / 20.0, p1 - v1 / 5.0, p1},
                 kTouching, std::abs(from.rate) <= kResting);
}

}  // namespace event_watch

/// The values watched in one substep, of a type that is a WatchedValue.
template <class Watched>
struct WatchedSubstep {
  std::vector<Watched> before, after;  ///< at its ends
  std::vector<char> is_muted;          ///< in this substep; may be shorter

  /// The earliest crossing that models of what is watched have between two places, h apart.
  /// `is_all`: these are both ends of a substep.
  std::optional<Crossing> earliest(const std::vector<Watched>& from, const std::vector<Watched>& to,
                                   double h, bool is_all) const {
    std::optional<Crossing> first;
    for (std::size_t k = 0; k < from.size(); ++k) {
      if (k < is_muted.size() && is_muted[k]) continue;
      std::optional<double> root =
          event_watch::first_crossing(from[k], to[k], h, before[k], is_all);
      if (!root && is_all && to[k].early > 0.0) root = to[k].early;
      if (root && (!first || *root < first->share)) first = Crossing{*root, k};
    }
    return first;
  }

  /// What has passed its event between two places.
  std::optional<std::size_t> find_passed(const std::vector<Watched>& from,
                                         const std::vector<Watched>& to) const {
    for (std::size_t k = 0; k < from.size(); ++k) {
      if (k < is_muted.size() && is_muted[k]) continue;
      const bool is_still =
          from[k].known == 2 && from[k].value <= kTouching && std::abs(from[k].rate) <= kResting;
      if (to[k].known == 0 ? to[k].value < event_watch::aim_of(from[k])
          : is_still       ? to[k].value < -kTouching
                           : to[k].value < -to[k].tolerance && to[k].rate < 0.0)
        return k;
    }
    return std::nullopt;
  }

  /// Ends the substep, which started at t and was h long, where the first event is, and leaves what
  /// is watched there in `after`. Or there is none after all, and the whole substep stays.
  /// `go_to(share, is_start)` takes the substep again that far, or not at all, and sets `after`;
  /// false where it cannot.
  template <class GoTo>
  bool locate(double t, double h, GoTo go_to_share, std::optional<Crossing>* event) {
    using namespace event_watch;  // NOLINT(google-build-using-namespace): its constants
    const double least = kLocated * std::max(1.0, std::abs(t));
    double low = 0.0, high = 1.0, here = 1.0;
    bool is_passed = find_passed(before, after).has_value();
    int low_for = 0, high_for = 0;  // times in a row that the other end has moved
    low_ = before;
    high_ = after;
    const auto go_to = [&](double share) {
      here = share;
      return go_to_share(share, share * h <= least);
    };
    for (int i = 0; i < kMostLocations; ++i) {
      const std::optional<Crossing> next =
          i == 0 ? *event : earliest(low_, high_, (high - low) * h, false);
      if (!next && !is_passed) break;
      double share = low + (next ? next->share : 1.0) * (high - low);
      if (i >= kMostNewton) share = 0.5 * (low + high);
      const bool is_last = is_passed && (high - low) * h <= 2.0 * least;
      if (is_last) share = high;
      if (!go_to(share)) return false;
      if (next) *event = next;
      const Watched& there = after[(*event)->which];
      const bool is_there =
          there.known == 0 ? std::abs(there.value - aim_of(before[(*event)->which])) <=
                                 0.5 * kLocatedForce * there.tolerance
                           : there.rate < 0.0 && std::abs(there.value) <=
                                                     std::max(there.tolerance, -least * there.rate);
      if (is_there || is_last || share * h <= least) return true;
      if (find_passed(before, after)) {
        high = share;
        high_ = after;
        is_passed = true;
        low_for = 0;
        if (++high_for > 1)
          for (Watched& w : low_)
            if (w.known == 0 && w.value > 0.0) w.value *= 0.5;  // Illinois
      } else {
        low = share;
        low_ = after;
        high_for = 0;
        if (++low_for > 1)
          for (Watched& w : high_)
            if (w.known == 0 && w.value < -4.0 * w.tolerance) w.value *= 0.5;
      }
    }
    if (here != high && !go_to(high)) return false;
    if (!is_passed) event->reset();
    return true;
  }

 private:
  std::vector<Watched> low_, high_;
};

}  // namespace constraint_sim::engine
