#pragma once

// Costs of events in substeps: substeps taken or tried in ticks with events, beyond those of ticks
// without events.

#include <utility>
#include <vector>

#include "judge_events.h"

namespace constraint_sim::engine::event_costs {

/// Shipped scenes that are event-driven.
inline constexpr const char* kScenes[] = {"safety_rope",    "breaking_rod",    "rocking_block",
                                          "newtons_cradle", "ball_on_incline", "weak_winch"};
inline constexpr double kDuration = 5.0;  // simulated time of these scenes [s]

struct Costs {
  unsigned ticks = 0, ticks_without = 0, events = 0;
  double without = 0.0, with = 0.0;                   // substeps of ticks without and with events
  std::vector<std::pair<double, unsigned>> of_ticks;  // substeps and events of ticks with events

  void add(const StepReport& report) {
    const double cost = report.costs.substeps + report.costs.rejected;
    ++ticks;
    if (report.costs.events == 0) {
      ++ticks_without;
      without += cost;
      return;
    }
    events += report.costs.events;
    with += cost;
    of_ticks.emplace_back(cost, report.costs.events);
  }
  double ordinary() const { return ticks_without > 0 ? without / ticks_without : 1.0; }
  double of_an_event() const {
    return (with - ordinary() * static_cast<double>(of_ticks.size())) / events;
  }
};

/// Runs a world until `duration`, or until impulses take over.
inline Costs follow(World world, double duration) {
  Costs costs;
  while (world.time() < duration) {
    const StepReport& report = world.step();
    if (random_events::is_with_impulses(world)) break;
    costs.add(report);
  }
  return costs;
}

}  // namespace constraint_sim::engine::event_costs
