#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <optional>

#include "engine/math/list.h"
#include "engine/methods/event_driven/event_watch.h"

namespace constraint_sim::engine {

/// Values watched in one substep. Watched is derived from WatchedValue.
template <class Watched>
struct WatchedSubstep {
  List<Watched> before, after;  ///< values at both ends of the substep
  List<int> unchanged;          ///< events in a row that changed nothing, per value; may be shorter

  double level(std::size_t k) const {
    return event_watch::level_of(before[k], k < unchanged.size() ? unchanged[k] : 0);
  }

  /// First event that is expected. Values that rest at zero have none.
  ExpectedEvent expected() const {
    ExpectedEvent first{kInfinity, 0};
    for (std::size_t k = 0; k < before.size(); ++k) {
      const bool moves = before[k].known == 2 && std::abs(before[k].rate) > before[k].resting;
      if (!moves && !is_clear(before[k])) continue;
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
    constexpr double kRounding = 4.0;  // rounding of times found from values, in their resolution
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
