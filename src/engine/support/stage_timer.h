#pragma once

#include <array>
#include <cstddef>

#include "constraint_sim/engine/report.h"
#include "constraint_sim/engine/world.h"

namespace constraint_sim::engine {

/// Run time of each stage [s].
using StageTimes = std::array<double, kStageCount>;

/// Measures a stage from construction to destruction, where there is a clock.
class StageTimer {
 public:
  StageTimer(Clock clock, Stage stage, StageTimes* times)
      : clock_(clock),
        time_((*times)[static_cast<std::size_t>(stage)]),
        start_(clock ? clock() : 0.0) {}
  ~StageTimer() {
    if (clock_) time_ += clock_() - start_;
  }
  StageTimer(const StageTimer&) = delete;
  StageTimer& operator=(const StageTimer&) = delete;

 private:
  Clock clock_;
  double& time_;
  double start_;
};

}  // namespace constraint_sim::engine
