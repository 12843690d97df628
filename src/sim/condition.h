#pragma once

namespace constraint_sim {

/// Something that begins, holds for a while and ends, as ticks that are dropped: each is reported
/// once. What comes again soon after it has ended has not ended.
class Condition {
 public:
  enum class Change { kNone, kBegan, kEnded };

  static constexpr double kEndsAfter = 2.0;  ///< [s] in which it did not hold

  /// `now` [s] from any origin.
  Change update(bool holds, double now) {
    if (holds) {
      last_held_ = now;
      if (has_begun_) return Change::kNone;
      has_begun_ = true;
      return Change::kBegan;
    }
    if (!has_begun_ || now < last_held_ + kEndsAfter) return Change::kNone;
    has_begun_ = false;
    return Change::kEnded;
  }
  bool has_begun() const { return has_begun_; }
  /// Ends the condition without a report.
  void forget() { has_begun_ = false; }

 private:
  bool has_begun_ = false;
  double last_held_ = 0.0;
};

}  // namespace constraint_sim
