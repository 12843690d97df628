#include "engine/methods/energy_momentum/energy_momentum.h"

#include <algorithm>
#include <cmath>

#include "engine/dynamics/fit_velocities.h"
#include "engine/math/list.h"
#include "engine/math/numbers.h"

namespace constraint_sim::engine {
namespace {

constexpr int kMostStepIterations = 25;
// Newton's method has converged where the change is below kStepSolved of the scene's size, or below
// kStepRounding and more than half of the change before, which is rounding; or where the next
// change, as the square of this one, will be below kSquared and row errors below kRowSquared, a
// hundredth of rounding. Larger remainders have one sign from step to step and let the energy drift
// like the rounding of 10⁴ times as many steps. Quadratic convergence is assumed for changes below
// kStepRounding of the extent of the mechanism, wherever it lies.
constexpr double kStepSolved = 1e-14;
constexpr double kStepRounding = 1e-7;
constexpr double kSquared = 1e-18;
constexpr double kRowSquared = 3e-18;
// Newton's method is given up where a change exceeds this multiple of the scene's size, and grows.
constexpr double kDiverged = 10.0;
// Largest row error of a converged step, as a share of the scene's size.
constexpr double kStepRowSolved = 1e-11;
// Largest error of a row without a force in the step, where a step with that force does not
// converge, as a share of the scene's size.
constexpr double kMomentaryOff = 1e-9;
// Row error below which energy is conserved: a force of 1e7 N does 1e-6 J of work over an error
// that is closed next.
constexpr double kMomentaryMet = 1e-13;

constexpr double kMostStepParts = 32.0;
// A midpoint step rotates a body by 2 atan(θ/2) instead of θ = h|W|, an error of θ³/kTurnOrder2;
// composed θ⁵/kTurnOrder4.
constexpr double kTurnOrder2 = 12.0, kTurnOrder4 = 1075.0;
// Intervals without a rejected step after which longer steps are tried.
constexpr int kIntervalsUntilLonger = 4;

// Coefficients of Suzuki's composition.
constexpr double kOuter = 1.0 / (4.0 - 1.5874010519681994748);  // 1.587… is the cubic root of 4
constexpr double kInner = 1.0 - 4.0 * kOuter;

}  // namespace

bool EnergyMomentum::start(const Interval& interval, EquationsOfMotion* equations,
                           List<BodyState>* states, IntegrationResult* progress) {
  for (auto& unknowns : found_) unknowns.assign(step_equations_.size(), 0.0);
  change_.assign(step_equations_.size(), 0.0);
  numbers_.resize(2 * equations->size());
  double* const y = numbers_.data();
  gather_state(*equations, *states, y);
  progress->projected = kinetic_energy(*equations, y);
  if (!equations->start(interval.t, y, y + equations->size())) return false;
  progress->projected -= kinetic_energy(*equations, y);
  equations->scatter_state(y, states);
  refinement_ = -1;
  intervals_since_ = 0;
  step_before_ = 0.0;
  return true;
}

// Number of steps by the rotation tolerance.
int EnergyMomentum::parts_for_turning(double h, bool composes, double tolerance) const {
  const auto [spin, speed] = step_equations_.largest_spin(kResolved / h);
  if (speed == 0.0 || tolerance == 0.0) return 1;
  const double longest = composes ? std::sqrt(std::sqrt(kTurnOrder4 * tolerance / speed))
                                  : std::sqrt(kTurnOrder2 * tolerance / speed);
  return static_cast<int>(std::clamp(std::ceil(h * spin / longest), 1.0, kMostStepParts));
}

double EnergyMomentum::turn_error(double turn, double tolerance) const {
  const double most = tolerance > 0.0 ? kMostStepParts : 1.0;
  const double angle = turn / (refinement_ > 0 ? std::ldexp(most, refinement_) : most);
  const double square = angle * angle;
  return turn * (refinement_ < 0 ? square * square / kTurnOrder4 : square / kTurnOrder2);
}

IntegrationResult EnergyMomentum::advance(const Interval& interval,
                                          const IntegratorOptions& options,
                                          EquationsOfMotion* equations, List<BodyState>* states) {
  IntegrationResult progress;
  was_first_ = !has_started_ || interval.is_edited || options.mode != mode_;
  mode_ = options.mode;
  stop_ = interval.stop;
  equations->begin(interval.t, *states, interval.gravity, interval.loads, interval.prescribed,
                   interval.since_tick);
  was_first_ = was_first_ || equations->inputs().has_jumped();
  if (was_first_ && !project(interval, options.most_projected, equations, states, &progress)) {
    progress.done = false;
    progress.is_inconsistent = true;
    return progress;
  }
  const bool composes = mode_ == ImplicitMode::kOrder4 && !step_equations_.has_dampers();
  if (++intervals_since_ > kIntervalsUntilLonger) {
    --refinement_;
    intervals_since_ = 0;
  }
  refinement_ = std::max(refinement_, composes ? -1 : 0);
  for (; refinement_ <= options.most_halvings; ++refinement_) {
    if (try_steps(interval, options, *states, equations, &progress)) {
      step_equations_.motion().scatter_state(*equations, states);
      return progress;
    }
    ++progress.rejected;
    intervals_since_ = 0;
    step_before_ = 0.0;
    for (auto& unknowns : found_) std::fill(unknowns.begin(), unknowns.end(), 0.0);
  }
  has_started_ = false;
  progress.done = false;
  progress.is_inconsistent = equations->redundant().is_inconsistent();
  return progress;
}

// Projects the velocities onto the joints and starts without history. Where more than `most` of the
// kinetic energy would be lost, keeps the velocities: the midpoint rule can start from
// velocities that are off the joints.
bool EnergyMomentum::project(const Interval& interval, double most, EquationsOfMotion* equations,
                             List<BodyState>* states, IntegrationResult* progress) {
  List<BodyState> before;
  if (std::isfinite(most)) before = states_of(*equations, *states);
  has_started_ = start(interval, equations, states, progress);
  if (!has_started_) return false;
  const double left = kinetic_energy(*equations, numbers_.data());
  if (progress->projected > most * (left + progress->projected)) {
    for (std::size_t i = 0; i < before.size(); ++i)
      (*states)[static_cast<std::size_t>(equations->bodies()[i])] = before[i];
    progress->projected = 0.0;
  }
  return true;
}

// Advances the interval by steps as refinement_ says. Returns false, without impulses, where the
// next refinement has to repeat it.
bool EnergyMomentum::try_steps(const Interval& interval, const IntegratorOptions& options,
                               const List<BodyState>& states, EquationsOfMotion* equations,
                               IntegrationResult* progress) {
  step_equations_.gather_state(states, *equations);
  const bool composes = refinement_ < 0;
  int parts = parts_for_turning(interval.h, composes, options.tolerance)
              << std::max(refinement_, 0);
  if (was_first_) {  // two halves at least, for the estimate
    parts += parts % 2;
    step_equations_.write_points(estimate_.start());
  }
  const double h = interval.h / parts;
  equations->keep_impulses();
  bool done = true;
  for (int k = 0; k < parts && done; ++k) {
    const double t = interval.t + k * h;
    done = composes ? composition(t, h, equations, progress) : step(t, h, 0, equations, progress);
    if (was_first_ && 2 * (k + 1) == parts) step_equations_.write_points(estimate_.middle());
  }
  const std::size_t redundant = equations->delassus().redundant();
  if (done && !step_equations_.redundant_rows_are_met(interval.t + interval.h, equations)) {
    done = false;
    if (equations->redundant().is_inconsistent()) refinement_ = options.most_halvings;
    // Repeat with all rows that are needed.
    if (equations->delassus().redundant() < redundant) --refinement_;
  }
  if (!done) {
    equations->restore_impulses();
    return false;
  }
  step_equations_.write_points(estimate_.end());
  const std::size_t bodies = equations->bodies().size();
  progress->local_error = was_first_ ? estimate_.first(interval.h, composes, parts, bodies)
                                     : estimate_.next(interval.h, composes, parts, bodies);
  return true;
}

bool EnergyMomentum::composition(double t, double h, EquationsOfMotion* equations,
                                 IntegrationResult* progress) {
  for (std::size_t stage = 0; stage < kCompositionStages; ++stage) {
    const double part = h * (stage == 2 ? kInner : kOuter);
    if (!step(t, part, stage, equations, progress)) return false;
    t += part;
  }
  return true;
}

bool EnergyMomentum::step(double t, double h, std::size_t stage, EquationsOfMotion* equations,
                          IntegrationResult* progress) {
  ImplicitRule rule = ImplicitRule::kMidpoint;
  const bool goes_on = are_equal_steps(h, step_before_);
  if (goes_on && mode_ == ImplicitMode::kDissipate) rule = ImplicitRule::kBdf2;
  if (!step_equations_.begin(t, h, rule, equations)) return false;
  unknowns_ = found_[stage];
  ++progress->substeps;
  if (!find_end(progress)) return false;
  const double off = step_equations_.system().worst_momentary_row() / step_equations_.scale();
  found_[stage] = unknowns_;
  if (off > kMomentaryMet) {
    step_equations_.leave_out_momentary_rows(false, *equations);
    if (!find_end(progress)) {
      if (off > kMomentaryOff) return false;
      step_equations_.leave_out_momentary_rows(true, *equations);
      unknowns_ = found_[stage];
      step_equations_.evaluate(unknowns_);
    }
    found_[stage] = unknowns_;
  }
  step_equations_.finish(unknowns_, equations);
  step_before_ = h;
  return true;
}

// Solves the step by Newton's method, starting from unknowns_. Returns false where it does not
// converge.
bool EnergyMomentum::find_end(IntegrationResult* progress) {
  double before = kInfinity;
  for (int i = 0; i < kMostStepIterations; ++i) {
    if (is_set(stop_)) return false;
    step_equations_.evaluate(unknowns_);
    const double worst_row = step_equations_.system().worst_row();
    for (std::size_t u = 0; u < change_.size(); ++u)
      change_[u] = -step_equations_.system().residual()[u];
    ++progress->iterations;
    if (!step_equations_.system().solve(change_.data())) return false;
    const double moved = step_equations_.add(change_.data(), &unknowns_) / step_equations_.scale();
    const bool diverges = i > 1 && moved > kDiverged && moved > before;
    if (!std::isfinite(moved) || diverges) return false;
    const bool is_rounding = moved < kStepRounding && moved > 0.5 * before;
    const bool is_solved = (moved < kStepSolved || is_rounding) &&
                           worst_row <= kStepRowSolved * step_equations_.scale();
    const double ratio = i > 0 ? (moved / before) * (moved / before) : kInfinity;
    const bool is_next_nothing =
        moved * ratio < kSquared && worst_row * ratio < kRowSquared * step_equations_.scale();
    const bool is_close =
        moved * step_equations_.scale() < kStepRounding * step_equations_.extent();
    if (is_solved || (is_close && is_next_nothing)) return true;
    before = moved;
  }
  return false;
}

}  // namespace constraint_sim::engine
