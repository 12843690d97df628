#pragma once

#include <algorithm>
#include <array>
#include <cstddef>
#include <tuple>

#include "engine/math/embedded_pairs.h"

namespace constraint_sim::engine {

/// A substep, whose stages show how forces change between its ends.
class StagedSubstep {
 public:
  StagedSubstep() = default;  ///< no substep: no stage is known
  /// Substep of length h [s] by the pair of this order.
  StagedSubstep(double h, int order) : h_(h), order_(order) {}

  /// Time from a stage to the end [s]. Stage 0 is the derivative at the end, with which the next
  /// substep starts.
  double until_end(std::size_t stage) const { return stage == 0 ? 0.0 : h_ * (1.0 - c(stage)); }
  /// Share of the substep at which a margin(stage) was below −tolerance: at a stage, or at the
  /// lowest point of a parabola through three of them; 0: nowhere. `at_end`: margin at the end.
  template <class Margin>
  double early_below(const Margin& margin, double at_end, double tolerance) const {
    if (h_ == 0.0) return 0.0;
    // Stages in order of time, between which margins are nearly parabolas.
    if (order_ == 8) return early_below(margin, at_end, tolerance, std::array{3, 5, 9, 10});
    if (order_ == 5) return early_below(margin, at_end, tolerance, std::array{1, 2, 3});
    if (order_ == 1) return 0.0;
    // By order 3 forces hardly change, and a parabola has no third place to go through.
    return margin(1) < -tolerance ? c(1) : 0.0;
  }

 private:
  double c(std::size_t stage) const {
    return order_ == 8   ? DormandPrince8::kC[stage]
           : order_ == 5 ? DormandPrince5::kC[stage]
                         : Kutta3::kC[stage];
  }
  template <class Margin, std::size_t n>
  double early_below(const Margin& margin, double at_end, double tolerance,
                     const std::array<int, n>& places) const {
    // A margin that changes by less than a quarter of itself between three places stays above zero.
    constexpr double kQuiet = 4.0;
    const auto [least, most] = std::minmax({margin(places[1]), margin(places[2]), at_end});
    if (least > kQuiet * (most - least) && least > 0.0) return 0.0;
    const std::size_t stages = order_ == 8 ? DormandPrince8::kStages : DormandPrince5::kStages;
    std::array<double, DormandPrince8::kStages> of_stage{};
    for (std::size_t i = 1; i < stages; ++i) {
      of_stage[i] = margin(i);
      if (of_stage[i] < -tolerance) return c(i);
    }
    struct Sample {
      double share, value;
    };
    std::array<Sample, n + 1> samples;
    for (std::size_t k = 0; k < n; ++k) {
      const auto i = static_cast<std::size_t>(places[k]);
      samples[k] = {c(i), of_stage[i]};
    }
    samples[n] = {1.0, at_end};
    for (std::size_t k = 0; k + 1 < n; ++k) {
      const auto& [l, m, r] = std::tie(samples[k], samples[k + 1], samples[k + 2]);
      if (m.value > std::min(l.value, r.value)) continue;
      const double fall = (m.value - l.value) / (m.share - l.share);
      const double rise = (r.value - m.value) / (r.share - m.share);
      const double bend = (rise - fall) / (r.share - l.share);
      if (!(bend > 0.0)) continue;
      const double slope = fall + bend * (m.share - l.share);  // at the middle sample
      if (m.value - 0.25 * slope * slope / bend < -tolerance) return m.share - 0.5 * slope / bend;
    }
    return 0.0;
  }

  double h_ = 0.0;
  int order_ = 8;
};

}  // namespace constraint_sim::engine
