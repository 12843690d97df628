#pragma once

#include <array>
#include <cstdint>
#include <string>

#include "constraint_sim/engine/world.h"

namespace constraint_sim {

/// Results, errors and costs of a number of ticks.
class TickStatistics {
 public:
  /// Adds a tick of `world`, which took `seconds` of run time [s].
  void add(const engine::World& world, double seconds);
  /// Starts the next interval; figures since the start stay.
  void clear();

  std::uint32_t ticks = 0;
  double simulated = 0.0;             ///< simulated time of the ticks [s]
  double max_constraint_error = 0.0;  ///< [m]
  std::string worst_constraint;
  double wall_sum = 0.0;                                 ///< [s]
  double wall_max = 0.0;                                 ///< [s]
  std::array<double, engine::kStageCount> stage_sums{};  ///< [s]
  double accumulated_local_error = 0.0;    ///< since the start [m]; NaN where a tick had none
  double local_error = 0.0;                ///< largest in one tick [m]; NaN where a tick had none
  std::uint64_t events = 0, substeps = 0;  ///< sums over the ticks
};

}  // namespace constraint_sim
