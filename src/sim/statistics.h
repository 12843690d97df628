#pragma once

#include <array>
#include <cstdint>
#include <string>

#include "constraint_sim/engine/world.h"

namespace constraint_sim {

/// What a number of ticks did, how wrong they were, and what they cost.
class TickStatistics {
 public:
  /// One more tick of this world, which took so long [s].
  void add(const engine::World& world, double seconds);
  /// Starts the next interval; what counts since the start stays.
  void clear();

  std::uint32_t ticks = 0;
  double simulated = 0.0;             ///< their time [s]
  double max_constraint_error = 0.0;  ///< [m]
  std::string worst_constraint;
  double wall_sum = 0.0;                                 ///< [s]
  double wall_max = 0.0;                                 ///< [s]
  std::array<double, engine::kStageCount> stage_sums{};  ///< [s]
  double accumulated_local_error = 0.0;    ///< since the start [m]; NaN where a tick had none
  double local_error = 0.0;                ///< largest of a tick [m]; NaN where a tick had none
  std::uint64_t events = 0, substeps = 0;  ///< sums over the ticks
};

}  // namespace constraint_sim
