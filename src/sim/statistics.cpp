#include "sim/statistics.h"

#include <algorithm>
#include <cmath>

namespace constraint_sim {

void TickStatistics::add(const engine::World& world, double seconds) {
  const engine::StepReport& report = world.report();
  ++ticks;
  simulated += world.options().time_step;
  if (report.joints.worst &&
      (worst_constraint.empty() || report.joints.max_error > max_constraint_error)) {
    max_constraint_error = report.joints.max_error;
    worst_constraint = world.joint(*report.joints.worst).name;
  }
  wall_sum += seconds;
  wall_max = std::max(wall_max, seconds);
  for (std::size_t i = 0; i < stage_sums.size(); ++i) stage_sums[i] += report.costs.stage_times[i];
  if (!std::isnan(local_error) && !(report.local_error <= local_error))
    local_error = report.local_error;  // a NaN stays until clear()
  if (world.step_count() != last_step_ + 1) accumulated_local_error = 0.0;
  accumulated_local_error += report.local_error;
  last_step_ = world.step_count();
  events += report.costs.events;
  substeps += report.costs.substeps;
}

void TickStatistics::clear() {
  TickStatistics next;
  next.accumulated_local_error = accumulated_local_error;
  next.last_step_ = last_step_;
  *this = next;
}

}  // namespace constraint_sim
