#pragma once

namespace constraint_sim {

/// A condition that begins, holds for a while and ends, such as dropped ticks; each change is
/// reported once. A condition that recurs within kEndsAfter has not ended.
class Condition {
 public:
  enum class Change { kNone, kBegan, kEnded };

  static constexpr double kEndsAfter =
      2.0;  ///< time without the condition after which it has ended [s]

  /// `now`: time [s] from any origin.
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
