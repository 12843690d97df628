#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <cstddef>
#include <iterator>
#include <type_traits>
#include <utility>

#include "constraint_sim/engine/stop_flag.h"
#include "engine/math/elementary.h"
#include "engine/math/embedded_pairs.h"
#include "engine/math/numbers.h"

namespace constraint_sim::engine {

// Explicit Runge-Kutta steps of any System, with as many substeps as the tolerance asks for.
//
// A System has a state of size() numbers and these functions, t in simulated seconds:
//   void derivative(std::size_t stage, double t, const double* y, double* dydt);
//   bool project(double t, double* y);             onto what positions have to keep; false: cannot
//   template <class Pair> void accept(double h);   the stages have made a step
//   bool restart(double* y, double* dydt);         after project(): projects velocities, stage 0
//   double squared_size_of(const double* dy, double h);  of an error over a step of h [m²]

/// Where the numbers are: the state, the candidate for the next one, an error, and the derivatives
/// of the stages one after the other.
class StageMemory {
 public:
  static constexpr std::size_t kDerivatives = 3;  ///< row of the first stage
  static constexpr std::size_t kRows = kDerivatives + DormandPrince8::kStages + 1;

  /// On `numbers`, kRows times `size` of them.
  StageMemory(double* numbers, std::size_t size)
      : state_(numbers),
        candidate_(numbers + size),
        error_(numbers + 2 * size),
        derivatives_(numbers + kDerivatives * size) {}

  double* state() const { return state_; }
  double* candidate() const { return candidate_; }
  double* error() const { return error_; }
  double* derivatives() const { return derivatives_; }

 private:
  double *state_, *candidate_, *error_, *derivatives_;
};

/// What came of it.
struct IntegrationResult {
  bool done = true;          ///< else the state is where it came to
  double local_error = 0.0;  ///< estimate, sum of the substeps [m]
  int substeps = 0;
  int rejected = 0;
  int iterations = 0;            ///< Newton's, where there are any
  bool is_inconsistent = false;  ///< not done because the joints cannot all be met
  double frequency = 0.0;        ///< of the joints' forces, where it decides on the next [rad/s]
  bool is_stiff = false;   ///< the other method is the better one; not done where it was so at once
  double projected = 0.0;  ///< kinetic energy that velocities lost when they were made to fit [J]
  double corrected = 0.0;  ///< energy that corrections of positions added, left in the bodies [J]
};

namespace runge_kutta {

inline constexpr double kSafety = 0.9;  // the next estimate is to come out below what is allowed
inline constexpr double kMostGrowth = 5.0;
inline constexpr double kMostShrinking = 0.2;
inline constexpr double kLeastShrinking = 0.73;
inline constexpr int kMostFailures = 100;  // of them without any result: rows are inconsistent

// Weights of the derivatives, as types, so that what is zero costs nothing.

template <class Pair, std::size_t kStage>
struct StageWeights {
  static constexpr std::size_t kTerms = kStage;
  static constexpr double at(std::size_t j) { return Pair::kA[kStage][j]; }
};
/// Of the differences to the embedded formulas.
template <const auto& kE>
struct ErrorWeights {
  static constexpr std::size_t kTerms = std::size(kE);
  static constexpr double at(std::size_t j) { return kE[j]; }
};

using Two = Eigen::Array2d;

template <class Number>
Number read(const double* numbers) {
  if constexpr (std::is_same_v<Number, double>)
    return *numbers;
  else
    return Eigen::Map<const Number>(numbers);
}

/// Σ w_j k_j over j < kTerms of one element, or of several as one Number; w_0 is not zero.
template <class Weights, class Number = double, std::size_t kTerms = Weights::kTerms>
Number sum(const double* k, std::size_t n) {
  constexpr double kWeight = Weights::at(kTerms - 1);
  if constexpr (kTerms == 1)
    return kWeight * read<Number>(k);
  else if constexpr (kWeight == 0.0)
    return sum<Weights, Number, kTerms - 1>(k, n);
  else
    return sum<Weights, Number, kTerms - 1>(k, n) + kWeight * read<Number>(k + (kTerms - 1) * n);
}

/// n is even.
template <class Weights>
void weigh(const double* k, std::size_t n, double* result) {
  for (std::size_t e = 0; e < n; e += 2) Eigen::Map<Two>(result + e) = sum<Weights, Two>(k + e, n);
}

/// y = y0 + h Σ kA[stage][j] k_j; n is even.
template <class Pair, std::size_t kStage>
void combine(const double* y0, const double* k, std::size_t n, double h, double* y) {
  for (std::size_t e = 0; e < n; e += 2)
    Eigen::Map<Two>(y + e) = read<Two>(y0 + e) + h * sum<StageWeights<Pair, kStage>, Two>(k + e, n);
}

template <class Pair, std::size_t kStage>
void combine(const StageMemory& memory, std::size_t n, double h) {
  combine<Pair, kStage>(memory.state(), memory.derivatives(), n, h, memory.candidate());
}

template <class Pair, std::size_t kStage, class System>
void stage(System& system, const StageMemory& memory, double t, double h) {
  const std::size_t n = system.size();
  combine<Pair, kStage>(memory, n, h);
  system.derivative(kStage, t + Pair::kC[kStage] * h, memory.candidate(),
                    memory.derivatives() + kStage * n);
}

/// All stages but the first, which is there.
template <class Pair, class System, std::size_t... kBefore>
void all_stages(System& system, const StageMemory& memory, double t, double h,
                std::index_sequence<kBefore...>) {
  (stage<Pair, kBefore + 1>(system, memory, t, h), ...);
}

/// Squared size of Σ kE[j] k_j.
template <const auto& kE, class System>
double squared_error(const System& system, const StageMemory& memory, double h) {
  weigh<ErrorWeights<kE>>(memory.derivatives(), system.size(), memory.error());
  return system.squared_size_of(memory.error(), h);
}

// The errors of the embedded formulas fall more slowly than that of the step. The powers of h that
// are missing are in their ratios; which ones is chosen so that all falls and rises together where
// a motion turns back, or passes its middle, and every other derivative vanishes. Never more than
// the error of the best of them. bench/error_estimates.cpp prints how well that works.

/// h⁶ (h⁶/h⁵)(h⁶/h⁴), times a factor fitted to pendulums, chains and free bodies.
template <class System>
double estimate(DormandPrince8, const System& system, const StageMemory& memory, double h) {
  constexpr double kFitted = 4.3;
  const double fifth2 = squared_error<DormandPrince8::kE5>(system, memory, h);
  const double fourth2 = squared_error<DormandPrince8::kE4>(system, memory, h);
  const double third2 = squared_error<DormandPrince8::kE3>(system, memory, h);
  if (fifth2 == 0.0) return 0.0;
  const double share2 = kFitted * kFitted * (fifth2 / fourth2) * (fifth2 / third2);
  return h * std::sqrt(fifth2 * std::min(1.0, share2));
}

/// h⁵ (h⁴/h³); it needs no factor.
template <class System>
double estimate(DormandPrince5, const System& system, const StageMemory& memory, double h) {
  const double fourth2 = squared_error<DormandPrince5::kE4>(system, memory, h);
  const double third2 = squared_error<DormandPrince5::kE3>(system, memory, h);
  const double second2 = squared_error<DormandPrince5::kE2>(system, memory, h);
  if (fourth2 == 0.0) return 0.0;
  return h * std::sqrt(fourth2 * std::min(1.0, third2 / second2));
}

/// One step, in candidate(); negative where there is none, else the estimate of its error [m].
template <class Pair, class System>
[[gnu::always_inline]] inline double attempt(System& system, const StageMemory& memory, double t,
                                             double h) {
  constexpr std::size_t kStages = Pair::kStages;
  all_stages<Pair>(system, memory, t, h, std::make_index_sequence<kStages - 1>());
  const std::size_t n = system.size();
  combine<Pair, kStages>(memory, n, h);
  if constexpr (Pair::kNeedsNext) {
    system.derivative(kStages, t + h, memory.candidate(), memory.derivatives() + kStages * n);
  }
  if (!system.project(t + h, memory.candidate())) return -1.0;
  const double error = estimate(Pair{}, system, memory, h);
  return std::isfinite(error) ? error : -1.0;
}

/// The root of order kOrder of x.
template <int kOrder>
double root(double x) {
  static_assert(kOrder == 8 || kOrder == 5);
  if constexpr (kOrder == 8)
    return std::sqrt(std::sqrt(std::sqrt(x)));
  else
    return math::fifth_root(x);
}

/// How much longer the next step can be, or how much shorter this one has to.
template <class Pair>
double stretch(double error, double allowed) {
  if (error < 0.0) return kMostShrinking;
  if (error < 1e-6 * allowed) return kMostGrowth;  // 0.9 · 1e6^(1/8) is already more
  const double ratio = kSafety * root<Pair::kErrorOrder - 1>(allowed / error);
  const double most = error > allowed ? kLeastShrinking : kMostGrowth;
  return std::clamp(ratio, kMostShrinking, most);
}

}  // namespace runge_kutta

/// What is left of a span that substeps go through.
struct SubstepSpan {
  double t;      ///< where the state is [s]
  double left;   ///< to the end [s]
  double end;    ///< [s]
  int failures;  ///< attempts without any result

  SubstepSpan(double start, double duration)
      : t(start), left(duration), end(start + duration), failures(0) {}
};

/// How long substeps may be, and when they are given up.
struct SubstepLimits {
  double tolerance;   ///< [m] of error per second; 0: whatever the error is
  int most_attempts;  ///< of a span, rejected substeps included
  StopFlag stop;
};

/// Takes one substep of at most `step` [s], which is set to what the next one is tried with. False
/// where it gives up. A call, so that its stages are in one place only, and inlined there.
template <class Pair, class System>
[[gnu::noinline]] bool take_substep(System& system, const StageMemory& memory,
                                    const SubstepLimits& limits, SubstepSpan& span, double& step,
                                    IntegrationResult& progress) {
  for (;;) {
    const bool is_last = span.left <= step;
    const double h = is_last ? span.left : span.left / std::ceil(span.left / step);
    if (progress.substeps + progress.rejected > limits.most_attempts || span.t + h == span.t ||
        is_set(limits.stop)) {
      progress.done = false;
      progress.is_inconsistent = span.failures > 0 && span.t + h == span.t;
      return false;
    }
    const double error = runge_kutta::attempt<Pair>(system, memory, span.t, h);
    const double allowed =
        limits.tolerance > 0.0 ? std::max(limits.tolerance * h, system.rounding()) : kInfinity;
    step = h * runge_kutta::stretch<Pair>(error, allowed);
    if (error < 0.0 || error > allowed) {
      ++progress.rejected;
      if (error < 0.0 && ++span.failures > runge_kutta::kMostFailures) {
        progress.done = false;
        progress.is_inconsistent = true;
        return false;
      }
      continue;
    }
    span.left = is_last ? 0.0 : span.left - h;
    span.t = span.end - span.left;
    ++progress.substeps;
    progress.local_error += error;
    system.template accept<Pair>(h);
    if (!system.restart(memory.candidate(), memory.derivatives())) {
      progress.done = false;
      return false;
    }
    std::copy(memory.candidate(), memory.candidate() + system.size(), memory.state());
    return true;
  }
}

/// Carries state() from t to t + duration. stage 0 of derivatives() is there before and after.
/// `tolerance` [m] of error per second; 0: one step whatever its error. `step` [s] is what the next
/// substep is tried with. Beyond `most_attempts` substeps, rejected ones included, it gives up,
/// and so it does once `stop` is set.
template <class Pair, class System>
IntegrationResult integrate(System& system, const StageMemory& memory, double t, double duration,
                            double tolerance, double& step, int most_attempts = 50000,
                            StopFlag stop = nullptr) {
  IntegrationResult progress;
  SubstepSpan span(t, duration);
  if (tolerance == 0.0) step = duration;
  const SubstepLimits limits{tolerance, most_attempts, stop};
  while (span.left > 0.0 && take_substep<Pair>(system, memory, limits, span, step, progress)) {
  }
  return progress;
}

}  // namespace constraint_sim::engine
