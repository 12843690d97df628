#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>

namespace constraint_sim {

/// Header stamps of messages. Stamps always advance, and go back only where they are simulated time
/// and that goes back. They stop at the last representable time: the year 2106 of wall time, or 136
/// years of simulated time.
class Stamps {
 public:
  static constexpr std::int64_t kLast = 4294967295999999999;  ///< last stamp, 2³² s - 1 ns [ns]

  enum class Source {
    kWall,       ///< wall time that follows simulated time evenly while the world runs
    kSimulated,  ///< simulated time itself
  };

  Stamps(Source source, double real_time_factor)
      : source_(source), real_time_factor_(real_time_factor) {}

  /// Returns the next stamp [ns] at simulated time `simulated` [s]; `now` is the wall time [ns].
  std::int64_t next(std::int64_t now, double simulated, bool running) {
    if (simulated < last_simulated_) restart();
    last_simulated_ = simulated;
    running = running && real_time_factor_ > 0.0;
    if (running && !anchored_) {
      wall_anchor_ = now;
      simulated_anchor_ = simulated;
    }
    anchored_ = running;
    last_ = std::min(std::max(of(now, simulated), last_ + least_advance(last_)), kLast);
    return last_;
  }

  /// Returns the stamp [ns] for a simulated time [s] without advancing; an earlier stamp may equal
  /// it.
  std::int64_t of(std::int64_t now, double simulated) const {
    if (source_ == Source::kSimulated) return nanoseconds(simulated);
    if (!anchored_ || simulated < last_simulated_) return now;
    const std::int64_t since = nanoseconds((simulated - simulated_anchor_) / real_time_factor_);
    return std::min(wall_anchor_ + since, kLast);
  }

  /// Converts to nanoseconds, clamped to 0 and kLast.
  static std::int64_t nanoseconds(double seconds) {
    if (!(seconds > 0.0)) return 0;
    return seconds < 4294967296.0 ? std::min(std::llround(seconds * 1e9), 0LL + kLast) : kLast;
  }

  /// Least advance from a stamp [ns]. Python's tf2 takes stamps as doubles of seconds, whose steps
  /// are 238 ns in 2026 and 477 ns from 2038; it complains of stamps that are equal.
  static std::int64_t least_advance(std::int64_t stamp) {
    const double seconds = 1e-9 * static_cast<double>(stamp);
    return std::max<std::int64_t>(1, std::llround(2e9 * (std::nextafter(seconds, 1e10) - seconds)));
  }

  /// Makes the next stamp start from wall time again, after simulated time lost its relation to
  /// wall time in a pause or through dropped ticks.
  void let_go() { anchored_ = false; }
  void set_real_time_factor(double factor) {
    let_go();
    real_time_factor_ = factor;
  }

 private:
  void restart() {
    let_go();
    if (source_ == Source::kSimulated) last_ = 0;
  }

  Source source_;
  double real_time_factor_;
  bool anchored_ = false;
  std::int64_t wall_anchor_ = 0;
  double simulated_anchor_ = 0.0;
  double last_simulated_ = 0.0;
  std::int64_t last_ = 0;
};

}  // namespace constraint_sim
