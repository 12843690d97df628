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

/// Log lines of the node: one when a condition begins and one when it ends, never one a tick. A
/// warning that the engine reports is a row of kReported in event_log.cpp. Stepping thread only,
/// except heard_clock().
class EventLog {
 public:
  /// Largest step of /clock that does not count as a jump [s].
  static constexpr double kClockJump = 1.0;

  explicit EventLog(const Parameters& parameters);

  void stepped(const World& world);
  void edited(const World& world);
  void passed(const World& world, const Stepper& stepper);
  /// Notes a message on /clock; times of the clock in the last message and this one [s], `before` =
  /// 0: no message before. Any thread.
  void heard_clock(double before, double now);

 private:
  /// Jumps of /clock in one direction.
  struct Jumps {
    std::uint64_t count = 0, noticed = 0, told = 0;
    double before = 0.0, after = 0.0;  ///< clock before and after the last jump [s]
    double told_at = -1e9;             ///< steady clock [s]
  };

  void report_broken(const World& world);
  void tell_of_range(const World& world);
  void tell_of_return(const World& world);
  void tell_of_failure(const World& world, const Stepper& stepper);
  void tell_of_dropped_ticks(const World& world, const Stepper& stepper, double now);
  void tell_of_clock(double now);
  void tell_of_jumps(double now);

  Parameters parameters_;
  std::vector<Condition> reported_;  // one for each row of kReported
  std::vector<double> held_for_;     // simulated time for which each condition has held [s]
  std::set<std::uint32_t> broken_;   // ids of joints known to be broken
  Condition beyond_range_;           // energy or errors that exceed the range of numbers
  Condition returning_;              // contacts that are event-driven again after impulses
  bool has_failed_ = false;
  Condition dropping_;
  std::uint64_t dropped_ticks_ = 0;
  double told_of_dropped_ = 0.0;  // steady clock [s]
  Condition without_clock_;
  std::atomic<double> last_clock_;  // steady clock [s]
  std::mutex jumps_mutex_;          // protects forward_ and back_
  Jumps forward_, back_;
  // Steady time until which dropped ticks are attributed, once, to a jump of /clock [s].
  double excused_until_ = 0.0;
};

}  // namespace constraint_sim
