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

// Explicit Runge-Kutta integration of a System, in as many substeps as the tolerance needs. A
// System has size() numbers as state, an error rounding() [m] below which rounding dominates, and
//   void derivative(std::size_t stage, double t, const double* y, double* dydt);
//   bool project(double t, double* y);             projects positions; false: impossible
//   template <class Pair> void accept(double h);   takes over the stages of a step
//   bool restart(double* y, double* dydt);         projects velocities, evaluates stage 0
//   double squared_size_of(const double* dy, double h);  squared error of a step of h [m²]; order 3
//       adds is_of_rates = true: without positions, where they err by as much as rates times h

/// Memory of the stages: the state, the candidate for the next state, an error, and the derivatives
/// of the stages.
class StageMemory {
 public:
  static constexpr std::size_t kDerivatives = 3;  ///< row of the first stage
  static constexpr std::size_t kRows = kDerivatives + DormandPrince8::kStages + 1;

  /// Uses `numbers`, kRows times `size` of them.
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

/// Result of an integration.
struct IntegrationResult {
  bool done = true;  ///< false: the state is at the time reached
  /// Without `done`: time from the start of the interval up to which the motion was found and the
  /// states belong to [s]; 0: the motion has to begin anew.
  double found = 0.0;
  double local_error = 0.0;  ///< sum of the error estimates of the substeps [m]
  int substeps = 0;
  int rejected = 0;
  int repeated = 0;              ///< substeps of joints that were taken again to end at an event
  int evaluations = 0;           ///< evaluations of the equations of motion in explicit substeps
  int iterations = 0;            ///< iterations of Newton's method, where used
  bool is_inconsistent = false;  ///< not done since the joints cannot all be met
  /// Frequency of the joints' forces, where it decides the next method [rad/s].
  double frequency = 0.0;
  /// Whether energy_momentum is cheaper, since `frequency` exceeds the limit. Nothing was
  /// integrated where `done` is false as well.
  bool is_stiff = false;
  double projected = 0.0;  ///< kinetic energy lost by projecting velocities [J]
  double corrected = 0.0;  ///< energy added by position corrections [J]
};

namespace runge_kutta {

inline constexpr double kSafety = 0.9;  // keeps the next estimate below the allowed error
// Bounds of the ratio of successive substeps: largest after an accepted one, smallest after any,
// and largest after a rejected one.
inline constexpr double kMostGrowth = 5.0;
inline constexpr double kMostShrinking = 0.2;
inline constexpr double kLeastShrinking = 0.73;
// Attempts without result, after which rows are inconsistent.
inline constexpr int kMostFailures = 100;

// Weights of the derivatives as types, so that zero weights cost nothing.

template <class Pair, std::size_t kStage>
struct StageWeights {
  static constexpr std::size_t kTerms = kStage;
  static constexpr double at(std::size_t j) { return Pair::kA[kStage][j]; }
};
/// Weights of the difference to an embedded formula.
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

/// Returns Σ w_j k_j over j < kTerms for one element, or for several as one Number; w_0 is not
/// zero.
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

/// Writes the weighted sums of all elements; n is even.
template <class Weights>
void weigh(const double* k, std::size_t n, double* result) {
  for (std::size_t e = 0; e < n; e += 2) Eigen::Map<Two>(result + e) = sum<Weights, Two>(k + e, n);
}

/// Writes y = y0 + h Σ kA[stage][j] k_j; n is even.
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

/// Evaluates all stages but the first, which is given.
template <class Pair, class System, std::size_t... kBefore>
void all_stages(System& system, const StageMemory& memory, [[maybe_unused]] double t,
                [[maybe_unused]] double h, std::index_sequence<kBefore...>) {
  (stage<Pair, kBefore + 1>(system, memory, t, h), ...);
}

/// Returns the squared size of Σ kE[j] k_j.
template <const auto& kE, class System>
double squared_error(const System& system, const StageMemory& memory, double h) {
  weigh<ErrorWeights<kE>>(memory.derivatives(), system.size(), memory.error());
  return system.squared_size_of(memory.error(), h);
}

// An embedded formula of order p has an error of h^(p+1), which falls more slowly with h than the
// error of the step. An estimate multiplies the error of the best embedded formula by ratios of
// errors; a ratio of two orders adds as many powers of h as the orders differ. Where a motion
// reverses or passes its middle, every other derivative vanishes; ratios are taken between errors
// which rise and fall together there. An estimate is at most the error of the best formula, and
// infinite where another error overflows. bench/error_estimates.cpp prints the accuracy.

/// Returns the estimate h⁶ (h⁶/h⁵)(h⁶/h⁴), with a factor fitted to pendulums, chains and free
/// bodies.
template <class System>
double estimate(DormandPrince8, const System& system, const StageMemory& memory, double h) {
  constexpr double kFitted = 4.3;
  const double fifth2 = squared_error<DormandPrince8::kE5>(system, memory, h);
  const double fourth2 = squared_error<DormandPrince8::kE4>(system, memory, h);
  const double third2 = squared_error<DormandPrince8::kE3>(system, memory, h);
  if (fifth2 == 0.0) return 0.0;
  if (!(fourth2 + third2 < kInfinity)) return kInfinity;
  const double share2 = kFitted * kFitted * (fifth2 / fourth2) * (fifth2 / third2);
  return h * std::sqrt(fifth2 * std::min(1.0, share2));
}

/// Returns the estimate h⁵ (h⁴/h³), which needs no factor.
template <class System>
double estimate(DormandPrince5, const System& system, const StageMemory& memory, double h) {
  const double fourth2 = squared_error<DormandPrince5::kE4>(system, memory, h);
  const double third2 = squared_error<DormandPrince5::kE3>(system, memory, h);
  const double second2 = squared_error<DormandPrince5::kE2>(system, memory, h);
  if (fourth2 == 0.0) return 0.0;
  if (!(third2 + second2 < kInfinity)) return kInfinity;
  return h * std::sqrt(fourth2 * std::min(1.0, third2 / second2));
}

/// Returns the error of the midpoint rule, which is at least that of the step: h times the error of
/// rates, h³, and the error of those positions that the system adds to it.
template <class System>
double estimate(Kutta3, const System& system, const StageMemory& memory, double h) {
  weigh<ErrorWeights<Kutta3::kE2>>(memory.derivatives(), system.size(), memory.error());
  return h * std::sqrt(system.squared_size_of(memory.error(), h, true));
}

template <class System>
double estimate(Euler, const System&, const StageMemory&, double) {
  return 0.0;
}

/// Writes a step to candidate(); returns its error estimate [m], or a negative number without a
/// result.
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

/// Returns the root of x of order kOrder.
template <int kOrder>
double root(double x) {
  static_assert(kOrder == 8 || kOrder == 5 || kOrder == 2 || kOrder == 1);
  if constexpr (kOrder == 8)
    return std::sqrt(std::sqrt(std::sqrt(x)));
  else if constexpr (kOrder == 5)
    return math::fifth_root(x);
  else if constexpr (kOrder == 2)
    return std::sqrt(x);
  else
    return x;
}

/// Returns the ratio of the next substep to this one.
template <class Pair>
double stretch(double error, double allowed) {
  if (error < 0.0) return kMostShrinking;
  if (error < 1e-6 * allowed) return kMostGrowth;  // 0.9 · 1e6^(1/8) exceeds kMostGrowth
  const double ratio = kSafety * root<Pair::kErrorOrder - 1>(allowed / error);
  const double most = error > allowed ? kLeastShrinking : kMostGrowth;
  return std::clamp(ratio, kMostShrinking, most);
}

}  // namespace runge_kutta

/// Part of an interval that substeps have yet to advance through.
struct RemainingInterval {
  double t;      ///< time of the state [s]
  double left;   ///< duration to the end [s]
  double end;    ///< end [s]
  int failures;  ///< number of attempts without any result

  RemainingInterval(double start, double duration)
      : t(start), left(duration), end(start + duration), failures(0) {}
};

/// Tolerance and limits of substeps.
struct SubstepLimits {
  double tolerance;   ///< error per second [m/s]; 0: any error
  int most_attempts;  ///< most substeps of an interval, rejected ones included
  StopFlag stop;
  bool tries_once = false;  ///< gives up where an attempt is rejected
};

/// Takes a substep of at most `step` [s], and sets `step` for the next one. Returns false where it
/// gives up. Not inlined, so that the stages, which are inlined here, exist only once.
template <class Pair, class System>
[[gnu::noinline]] bool take_substep(System& system, const StageMemory& memory,
                                    const SubstepLimits& limits, RemainingInterval& rest,
                                    double& step, IntegrationResult& progress) {
  for (;;) {
    const bool is_last = rest.left <= step;
    const double h = is_last ? rest.left : rest.left / std::ceil(rest.left / step);
    if (progress.substeps + progress.rejected > limits.most_attempts || rest.t + h == rest.t ||
        is_set(limits.stop)) {
      progress.done = false;
      progress.is_inconsistent = rest.failures > 0 && rest.t + h == rest.t;
      return false;
    }
    const double error = runge_kutta::attempt<Pair>(system, memory, rest.t, h);
    progress.evaluations += Pair::kStages - (Pair::kNeedsNext ? 0 : 1);
    const double allowed =
        limits.tolerance > 0.0 ? std::max(limits.tolerance * h, system.rounding()) : kInfinity;
    step = h * runge_kutta::stretch<Pair>(error, allowed);
    if (error < 0.0 || error > allowed) {
      ++progress.rejected;
      if (limits.tries_once) return false;
      if (error < 0.0 && ++rest.failures > runge_kutta::kMostFailures) {
        progress.done = false;
        progress.is_inconsistent = true;
        return false;
      }
      continue;
    }
    rest.left = is_last ? 0.0 : rest.left - h;
    rest.t = rest.end - rest.left;
    ++progress.substeps;
    progress.local_error += error;
    system.template accept<Pair>(h);
    ++progress.evaluations;
    if (!system.restart(memory.candidate(), memory.derivatives())) {
      progress.done = false;
      return false;
    }
    std::copy(memory.candidate(), memory.candidate() + system.size(), memory.state());
    return true;
  }
}

/// Advances state() from t to t + duration; derivatives() has stage 0 before and after. `tolerance`
/// is the error per second [m/s]; 0: a single step with any error. `step` [s] is the first substep,
/// and then the proposed next one. Gives up after `most_attempts` substeps, rejected ones included,
/// or once `stop` is set.
template <class Pair, class System>
IntegrationResult integrate(System& system, const StageMemory& memory, double t, double duration,
                            double tolerance, double& step, int most_attempts = 50000,
                            StopFlag stop = nullptr) {
  IntegrationResult progress;
  RemainingInterval rest(t, duration);
  if (tolerance == 0.0) step = duration;
  const SubstepLimits limits{tolerance, most_attempts, stop};
  while (rest.left > 0.0 && take_substep<Pair>(system, memory, limits, rest, step, progress)) {
  }
  return progress;
}

}  // namespace constraint_sim::engine
