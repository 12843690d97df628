#pragma once

#include <atomic>
#include <cstdint>
#include <mutex>
#include <set>
#include <string>
#include <vector>

#include "constraint_sim/engine/world.h"
#include "ros/parameters.h"
#include "sim/condition.h"
#include "sim/stepper.h"

namespace constraint_sim {

/// What the node says by itself: a line when something begins and one when it is over, never one a
/// tick. What the engine reports is a row of kReported in event_log.cpp. On the stepping thread,
/// but for heard_clock().
class EventLog {
 public:
  /// [s] by which a clock goes on at once, beyond which it has jumped
  static constexpr double kClockJump = 1.0;

  explicit EventLog(const Parameters& parameters);

  void stepped(const World& world);
  void edited(const World& world);
  void passed(const World& world, const Stepper& stepper);
  /// /clock has come, and said these before and now [s]; 0: nothing before. On any thread.
  void heard_clock(double before, double now);

 private:
  /// Jumps of /clock in one direction.
  struct Jumps {
    std::uint64_t count = 0, noticed = 0, told = 0;
    double before = 0.0, after = 0.0;  ///< times of the clock at the last jump [s]
    double told_at = -1e9;             ///< [s]
  };

  void report_broken(const World& world);
  void tell_of_return(const World& world);
  void tell_of_failure(const World& world, const Stepper& stepper);
  void tell_of_dropped_ticks(const World& world, const Stepper& stepper, double now);
  void tell_of_clock(double now);
  void tell_of_jumps(double now);

  Parameters parameters_;
  std::vector<Condition> reported_;  // one for each of kReported
  std::vector<double> held_for_;     // simulated time for which each has held [s]
  std::set<std::uint32_t> broken_;   // ids of joints that are known to be
  Condition returning_;              // of contacts from impulses
  bool has_failed_ = false;
  Condition dropping_;
  std::uint64_t dropped_ticks_ = 0;
  double told_of_dropped_ = 0.0;  // [s]
  Condition without_clock_;
  std::atomic<double> last_clock_;  // [s]
  std::mutex jumps_mutex_;          // protects forward_ and back_
  Jumps forward_, back_;
  // ticks that are dropped until then, once, are those of a jump of /clock [s]
  double excused_until_ = 0.0;
};

}  // namespace constraint_sim
