#pragma once

#include <atomic>
#include <cstdint>
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
  explicit EventLog(const Parameters& parameters);

  void stepped(const World& world);
  void edited(const World& world);
  void passed(const World& world, const Stepper& stepper);
  /// /clock has come. On any thread.
  void heard_clock();

 private:
  void report_broken(const World& world);
  void tell_of_return(const World& world);
  void tell_of_failure(const World& world, const Stepper& stepper);
  void tell_of_dropped_ticks(const World& world, const Stepper& stepper, double now);
  void tell_of_clock(double now);

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
};

}  // namespace constraint_sim
