#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>

namespace constraint_sim {

/// Header stamps for what is published: wall time that follows simulated time evenly while the
/// world runs, and never stands or goes back.
class Stamps {
 public:
  explicit Stamps(double real_time_factor) : real_time_factor_(real_time_factor) {}

  /// The next stamp [ns], of a world at this simulated time [s]; `now` is the wall time [ns].
  std::int64_t next(std::int64_t now, double simulated, bool running) {
    running = running && real_time_factor_ > 0.0;
    if (running && !anchored_) {
      wall_anchor_ = now;
      simulated_anchor_ = simulated;
    }
    anchored_ = running;
    const std::int64_t stamp =
        running
            ? wall_anchor_ + std::llround((simulated - simulated_anchor_) / real_time_factor_ * 1e9)
            : now;
    last_ = std::max(stamp, last_ + 1);
    return last_;
  }

  /// Simulated time has lost touch with the wall (ticks dropped, another scene): the next stamp is
  /// taken from the wall again.
  void let_go() { anchored_ = false; }

 private:
  double real_time_factor_;
  bool anchored_ = false;
  std::int64_t wall_anchor_ = 0;
  double simulated_anchor_ = 0.0;
  std::int64_t last_ = 0;
};

}  // namespace constraint_sim
