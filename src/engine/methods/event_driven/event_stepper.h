#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <utility>

#include "engine/math/integrate.h"
#include "engine/math/list.h"
#include "engine/methods/event_driven/event_watch.h"
#include "engine/methods/event_driven/law_events.h"
#include "engine/methods/event_driven/watched_substep.h"

namespace constraint_sim::engine {

/// Ends substeps at events, and counts the events of a step. An event is where a watched value
/// passes its level; the substep is repeated to end there, and the system changes its states. A
/// value whose event has changed nothing is muted until something changes.
///
/// Watched is derived from WatchedValue. Functions of the system are
///   bool repeat(double h);  repeats the substep with length h; 0: returns to its start; false:
///                           impossible
///   void watch(List<Watched>* list);       lists the values at the present state
///   bool accept(double h);                 whether a substep of length h may stay
///   bool change(const Watched& event, bool* is_changed);  false: no solution
template <class Watched>
class EventStepper {
 public:
  void begin_step() {
    events_ = 0;
    unchanged_ = 0;
    substeps_before_ = 0.0;
  }
  void begin_interval() {
    watched_.unchanged.clear();
    in_vain_ = 0;
    longest_of_order_3_ = kInfinity;
  }
  /// Values at the start of the next substep.
  List<Watched>* before() { return &watched_.before; }
  const List<Watched>& before() const { return watched_.before; }
  void count_event() { ++events_; }
  std::uint32_t events() const { return events_; }
  /// Substeps and events of the step. `progress`: of the present interval.
  double work(const IntegrationResult& progress) const {
    return substeps_before_ + progress.substeps + progress.rejected + static_cast<double>(events_);
  }
  void end_interval(const IntegrationResult& progress) {
    substeps_before_ += progress.substeps + progress.rejected;
  }

  /// Takes a substep of at most `step` [s] from the start of `left`. The substep ends at the next
  /// event where one is expected before, so it ends at its event at once where accelerations are
  /// constant, and is repeated less often elsewhere. `step` does not become shorter for an expected
  /// event. Where two expected events in a row did not come, no further one is expected before the
  /// next event or the end of the interval; without a tolerance none is. `take(part)` takes a
  /// substep in the interval `part`.
  template <class Take>
  bool take_substep(const IntegratorOptions& options, const IntegrationResult& progress,
                    const Take& take, RemainingInterval* left, double* step) {
    const RemainingInterval start = *left;
    const double longest = *step;
    const int rejected = progress.rejected;
    expect_event(start, options.tolerance > 0.0 ? longest : 0.0);
    RemainingInterval part = expected_ ? RemainingInterval(start.t, expected_->time) : start;
    const bool is_taken = take(&part);
    *left = expected_ ? remaining_after(start, expected_->time - part.left) : part;
    if (expected_ && progress.rejected == rejected) *step = std::max(*step, longest);
    return is_taken;
  }
  /// Options of the present substep. Short substeps, as between bounces of a body that is about to
  /// rest, are taken by order 5, or by a lower one where note_try() says so: with fewer stages,
  /// within the same tolerance.
  IntegratorOptions of_substep(IntegratorOptions options) const {
    if (order_ != 0) options.order = order_;
    return options;
  }
  /// Lower order, 1 or 3, that is worth a try in the present substep; 0: none. `longest_shift`:
  /// longest substep of order 1 [s].
  int order_to_try(double longest_shift) const {
    if (!is_short_) return 0;
    if (expected_->time <= longest_shift) return 1;
    return expected_->time < longest_of_order_3_ ? 3 : 0;
  }
  /// Takes over whether a try of the order has been within the tolerance.
  void note_try(int order, bool is_taken) {
    if (is_taken) order_ = order;
    if (order < 3) return;
    longest_of_order_3_ =
        is_taken ? std::max(longest_of_order_3_, 2.0 * expected_->time) : 0.5 * expected_->time;
  }
  /// Takes over that a substep of this length is repeated with length h.
  void note_repeat(double h, double length) {
    if (!is_short_) order_ = h < kShort * length ? 5 : 0;
  }

  /// Ends a substep from `start` to `left` at its first event. Returns false where no event is
  /// found, or where the states at the event have no solution.
  template <class Repeat, class Watch, class Accept, class Change>
  bool end_substep(const RemainingInterval& start, const Repeat& repeat, const Watch& watch,
                   const Accept& accept, const Change& change, RemainingInterval* left) {
    const double h = start.left - left->left;
    watch(&watched_.after);
    std::optional<Crossing> event = watched_.earliest(watched_.before, watched_.after, h, true);
    const auto go_to = [&](double share, bool is_start) {
      if (!repeat(is_start ? 0.0 : share * h)) return false;
      const RemainingInterval now = is_start ? start : remaining_after(start, share * h);
      left->t = now.t;
      left->left = now.left;
      left->failures = now.failures;
      watch(&watched_.after);
      return true;
    };
    if (const auto there = watched_.at_end(start.t, h, event, expected_))
      event = there;
    else if (event && !watched_.locate(start.t, h, go_to, &event))
      return false;
    if (!accept(h)) return go_to(0.0, true);
    std::swap(watched_.before, watched_.after);
    const bool is_in_vain = expected_ && h >= kReached * expected_->time;
    in_vain_ = event ? 0 : in_vain_ + (is_in_vain ? 1 : 0);
    if (event) return change_at(event->which, change);
    watched_.unchanged.clear();
    return true;
  }

 private:
  // Share of a substep without events, below which a substep is short.
  static constexpr double kShort = 1.0 / 32;
  // A substep of at least this share of the time to an expected event that finds no event counts as
  // in vain.
  static constexpr double kReached = 0.999;

  // Expects an event in a substep of at most `step` [s], where the present accelerations lead to
  // it.
  void expect_event(const RemainingInterval& start, double step) {
    constexpr int kMostInVain = 3;
    // An event that did not come when expected, and is now expected within this share of that time,
    // is near: the substep was not in vain.
    constexpr double kNearer = 1.0 / 16;
    const ExpectedEvent next = watched_.expected();
    const double least = 2.0 * event_watch::kLocatedTime * std::max(1.0, std::abs(start.t));
    if (expected_ && next.which == expected_->which && next.time < kNearer * expected_->time)
      in_vain_ = 0;
    expected_.reset();
    order_ = 0;
    is_short_ = false;
    const bool is_within = next.time > least && next.time < std::min(step, start.left);
    if (!is_within || in_vain_ >= kMostInVain) return;
    expected_ = next;
    is_short_ = next.time < kShort * step;
    if (is_short_) order_ = 5;
  }

  template <class Change>
  bool change_at(std::size_t which, const Change& change) {
    ++events_;
    const Watched event = watched_.before[which];
    const std::size_t count = watched_.before.size();
    bool is_changed = false;
    if (!change(event, &is_changed)) return false;
    if (is_changed) {
      watched_.unchanged.clear();
      return true;
    }
    watched_.unchanged.resize(count, 0);
    ++watched_.unchanged[which];
    return ++unchanged_ <= kMostUnchanged;
  }

  WatchedSubstep<Watched> watched_;
  std::uint32_t events_ = 0;
  double substeps_before_ = 0.0;           // substeps of earlier intervals of the step
  int unchanged_ = 0;                      // events that changed nothing
  std::optional<ExpectedEvent> expected_;  // event at which the substep is to end
  int in_vain_ = 0;                        // expected events in a row that were none
  int order_ = 0;                          // order of the present substep; 0: as usual
  bool is_short_ = false;                  // whether the present substep is short from its start
  double longest_of_order_3_ = kInfinity;  // shorter substeps are tried by order 3 [s]
};

}  // namespace constraint_sim::engine
