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
  /// Starts the next interval; the sum of local errors stays.
  void clear();

  std::uint32_t ticks = 0;
  double simulated = 0.0;             ///< simulated time of the ticks [s]
  double max_constraint_error = 0.0;  ///< [m]
  std::string worst_constraint;
  double wall_sum = 0.0;                                 ///< [s]
  double wall_max = 0.0;                                 ///< [s]
  std::array<double, engine::kStageCount> stage_sums{};  ///< [s]
  /// Sum since time 0 or a loaded scene [m]; NaN where a tick had none.
  double accumulated_local_error = 0.0;
  double local_error = 0.0;                ///< largest in one tick [m]; NaN where a tick had none
  std::uint64_t events = 0, substeps = 0;  ///< sums over the ticks

 private:
  std::uint64_t last_step_ = 0;  // step count of the world after the last tick
};

}  // namespace constraint_sim
