#include "engine/methods/runge_kutta/runge_kutta.h"

#include <cmath>
#include <utility>

#include "engine/dynamics/kernels/chain_of_bodies.h"
#include "engine/dynamics/kernels/chain_of_rods.h"
#include "engine/dynamics/kernels/point_on_rod.h"
#include "engine/dynamics/kernels/tree_of_bodies.h"
#include "engine/dynamics/kernels/tree_system.h"
#include "engine/math/list.h"
#include "engine/math/numbers.h"
#include "engine/methods/runge_kutta/integrate_by_order.h"

namespace constraint_sim::engine {
namespace {

// Bound on h ω beyond which no pair is stable. Intervals with few substeps do not need ω.
constexpr double kMostStable = 8.0;
constexpr double kFarTooStiff = 15.0;

}  // namespace

RungeKutta::RungeKutta(EquationsOfMotion equations)
    : equations_(std::move(equations)), tree_(equations_) {
  numbers_.resize(StageMemory::kRows * equations_.size());
}

void RungeKutta::restart() {
  has_started_ = has_other_forces_ = false;
  tree_.restart();
  step_ = 0.0;
  equations_.forget_redundant_rows();
}

template <class Act>
auto RungeKutta::with_system(Act act) {
  if (equations_.delassus().redundant() > 0)  // kernels contain all rows
    return act(equations_);
  if (equations_.is_point_on_rod()) {
    PointOnRod point(equations_);
    return act(point);
  }
  if (equations_.is_chain_of_bodies()) {
    ChainOfBodies chain(equations_);
    return act(chain);
  }
  if (equations_.is_tree()) {
    TreeOfBodies tree(equations_);
    return act(tree);
  }
  if (!equations_.is_chain()) return act(equations_);
  ChainOfRods chain(equations_);
  return act(chain);
}

IntegrationResult RungeKutta::begin(const Interval& interval, const IntegratorOptions& options,
                                    const List<BodyState>& states) {
  const bool has_other_forces = std::exchange(has_other_forces_, false) ||
                                (interval.is_disturbed && !equations_.has_loads(interval.loads));
  if (interval.is_edited || (has_other_forces && !tree_.is_current())) forget();
  if (has_other_forces && tree_.is_current()) {
    equations_.set_loads(interval.gravity, interval.loads);
    tree_.set_placed(false);
  }
  const IntegrationResult begun = begin_equations(interval, options, states);
  if (!begun.done || !tree_.can_advance(equations_)) return begun;
  TreeSystem system = TreeSystem::for_impulses(equations_, tree_, options.order);
  const bool goes_on = tree_.is_current();
  if (!goes_on) system.read(interval.t);
  if (tree_.is_current()) system.begin(interval.t);
  if (goes_on && has_other_forces) system.start(interval.t);
  return begun;
}

// Begins an interval in the state of the equations. Where joint coordinates go on, sets only the
// inputs of the interval.
IntegrationResult RungeKutta::begin_equations(const Interval& interval,
                                              const IntegratorOptions& options,
                                              const List<BodyState>& states) {
  const StageMemory memory(numbers_.data(), equations_.size());
  double* const y = memory.state();
  if (!has_started_) gather_state(equations_, states, y);
  const bool begins = !has_started_ || equations_.inputs().is_time_dependent();
  if (begins)
    equations_.begin(interval.t, states, interval.gravity, interval.loads, interval.prescribed,
                     interval.since_tick);
  // has_jumped() is of the last begin(): without a begin() now, an earlier interval handled it.
  const bool has_jumped = begins && equations_.inputs().has_jumped();
  if (tree_.is_current() && (has_jumped || !tree_.can_advance(equations_))) {
    tree_.forget();
    has_started_ = false;
    gather_state(equations_, states, y);
  }
  if (tree_.is_current()) return {};
  if (!has_started_ || has_jumped || tree_.can_advance(equations_) ||
      !equations_.satisfies_velocity_constraints(interval.t, y))
    return start(interval, options, memory);
  return {};
}

IntegrationResult RungeKutta::advance(const Interval& interval, const IntegratorOptions& options,
                                      List<BodyState>* states) {
  equations_.keep_impulses();
  const IntegrationResult result = integrate_interval(interval, options, states);
  if (!result.done) equations_.restore_impulses();
  return result;
}

IntegrationResult RungeKutta::integrate_interval(const Interval& interval,
                                                 const IntegratorOptions& options,
                                                 List<BodyState>* states) {
  const IntegrationResult begun = begin(interval, options, *states);
  if (!begun.done) return begun;
  if (tree_.is_current()) {
    IntegrationResult progress = integrate_tree(interval, options, states);
    progress.projected += begun.projected;
    if (!tree_.is_left_to_rows()) return progress;
    equations_.restore_impulses();
    return integrate_interval(interval, options, states);
  }
  const StageMemory memory(numbers_.data(), equations_.size());
  const double momentary = equations_.redundant().momentary_error();
  IntegrationResult progress = integrate_equations(memory, interval, options);
  progress.local_error += equations_.redundant().momentary_error() - momentary;
  progress.projected = begun.projected + equations_.take_projected_energy();
  progress.is_inconsistent =
      !progress.done && (progress.is_inconsistent || equations_.redundant().is_inconsistent());
  if (may_be_stiff(interval, options, progress.substeps)) note_stiffness(options, &progress);
  if (progress.done)
    equations_.scatter_state(memory.state(), states);
  else
    has_started_ = false;
  return progress;
}

// Whether so many substeps were taken that the frequency of the joints' forces matters.
bool RungeKutta::may_be_stiff(const Interval& interval, const IntegratorOptions& options,
                              int substeps) const {
  return std::isfinite(options.most_frequency) &&
         kMostStable * substeps >= options.most_frequency * interval.h;
}

void RungeKutta::note_stiffness(const IntegratorOptions& options, IntegrationResult* progress) {
  progress->frequency = equations_.frequency();
  progress->is_stiff = progress->frequency > options.most_frequency;
}

// Integrates in joint coordinates. The bodies are unchanged where that fails, or a pivot is lost.
IntegrationResult RungeKutta::integrate_tree(const Interval& interval,
                                             const IntegratorOptions& options,
                                             List<BodyState>* states) {
  TreeSystem system = TreeSystem::for_impulses(equations_, tree_, options.order);
  IntegrationResult progress =
      integrate(system, tree_.memory(), interval.t, interval.h, options, interval.stop, step_);
  if (!progress.done) {
    tree_.note_failure(progress);
    forget();
    return progress;
  }
  progress.projected = system.projected();
  system.note_coordinates();
  system.scatter(states);
  if (may_be_stiff(interval, options, progress.substeps)) {
    system.write_state(numbers_.data());
    equations_.place_bodies(interval.t + interval.h, numbers_.data());
    note_stiffness(options, &progress);
  }
  return progress;
}

// ---- substep by substep

bool RungeKutta::advance_substep(const Interval& interval, const IntegratorOptions& options,
                                 RemainingInterval* left, IntegrationResult* progress) {
  if (tree_.is_current()) return advance_in_coordinates(interval, options, left, progress);
  const StageMemory memory(numbers_.data(), equations_.size());
  if (options.tolerance == 0.0 || step_ == 0.0) step_ = left->left;
  has_started_ = with_system([&](auto& system) {
    return take_substep_by_order(system, memory, options, interval.stop, left, &step_, progress);
  });
  progress->projected += equations_.take_projected_energy();
  return has_started_;
}

// Takes a substep in joint coordinates. Where a pivot is lost, the substep begins again by rows:
// from the state at its start, and with the impulses saved there by keep_start().
bool RungeKutta::advance_in_coordinates(const Interval& interval, const IntegratorOptions& options,
                                        RemainingInterval* left, IntegrationResult* progress) {
  TreeSystem system(equations_, tree_);
  system.begin(left->t);
  if (options.tolerance == 0.0 || step_ == 0.0) step_ = left->left;
  const RemainingInterval start = *left;
  const IntegrationResult before = *progress;
  if (take_substep_by_order(system, tree_.memory(), options, interval.stop, left, &step_,
                            progress)) {
    progress->projected += system.projected();
    system.note_coordinates();
    return true;
  }
  if (options.order <= 3) return false;  // tried
  tree_.note_failure(*progress);
  if (!tree_.is_left_to_rows()) return false;
  *left = start;
  *progress = before;
  equations_.restore_first_stage();
  system.write_start(start.t, numbers_.data());
  has_started_ = equations_.start(start.t, numbers_.data(),
                                  numbers_.data() + StageMemory::kDerivatives * equations_.size());
  if (!has_started_) return false;
  keep_start();
  return advance_substep(interval, options, left, progress);
}

bool RungeKutta::try_substep(const Interval& interval, const IntegratorOptions& options,
                             RemainingInterval* left, IntegrationResult* progress) {
  const RemainingInterval start = *left;
  const IntegrationResult before = *progress;
  const double step = step_;
  if (advance_substep(interval, options, left, progress)) {
    step_ = step;  // for the usual order
    return true;
  }
  const int evaluations = progress->evaluations;
  *left = start;
  *progress = before;
  progress->evaluations = evaluations;
  step_ = step;
  has_started_ = true;
  return_to_start();
  return false;
}

void RungeKutta::scatter(List<BodyState>* states) {
  if (tree_.is_current())
    TreeSystem(equations_, tree_).scatter(states);
  else
    equations_.scatter_state(numbers_.data(), states);
}

void RungeKutta::find_accelerations(double t, Motions* rates) {
  if (!tree_.is_current())
    return engine::find_accelerations(
        equations_, numbers_.data(),
        numbers_.data() + StageMemory::kDerivatives * equations_.size(), rates);
  if (!tree_.is_placed()) TreeSystem(equations_, tree_).place_start(t);
  tree_.find_accelerations(rates);
}

void RungeKutta::keep_start() {
  const bool is_tree = tree_.is_current();
  const std::size_t n = is_tree ? tree_.tree().size : equations_.size();
  const double* const state = is_tree ? tree_.memory().state() : numbers_.data();
  const double* const rates = state + StageMemory::kDerivatives * n;
  kept_.assign(state, state + n);
  kept_.insert(kept_.end(), rates, rates + n);
  if (is_tree) {
    kept_momentum_ = tree_.momentum();
    kept_size_ = tree_.size();
  }
  equations_.keep_first_stage();
}

void RungeKutta::return_to_start() {
  const bool is_tree = tree_.is_current();
  const std::size_t n = is_tree ? tree_.tree().size : equations_.size();
  double* const state = is_tree ? tree_.memory().state() : numbers_.data();
  std::copy_n(kept_.data(), n, state);
  std::copy_n(kept_.data() + n, n, state + StageMemory::kDerivatives * n);
  equations_.restore_first_stage();
  if (!is_tree) return;
  tree_.momentum() = kept_momentum_;
  tree_.set_size(kept_size_);
  TreeSystem(equations_, tree_).place_start(equations_.coordinates().time());
}

double RungeKutta::longest_shift(const Motions& rates, const List<BodyState>& states) const {
  const List<int>& bodies = equations_.bodies();
  double bend = 0.0;  // [m/s²]
  for (std::size_t i = 0; i < bodies.size(); ++i) {
    bend = larger(bend, rates.linear[i].norm());
    if (!equations_.rotates(i)) continue;
    const double turn = rates.angular[i].norm() + states[bodies[i]].angular_velocity.squaredNorm();
    bend = larger(bend, equations_.radius_of_gyration(i) * turn);
  }
  return bend > 0.0 ? std::sqrt(2.0 * equations_.rounding() / bend) : 0.0;
}

bool RungeKutta::shift_end(const Interval& interval, IntegratorOptions options, double t,
                           double shift, IntegrationResult* progress) {
  options.order = 1;
  options.tolerance = 0.0;
  RemainingInterval left(t, shift);
  IntegrationResult shifted;
  const double step = step_;
  const bool is_taken = advance_substep(interval, options, &left, &shifted);
  step_ = step;
  progress->evaluations += shifted.evaluations;
  return is_taken;
}

bool RungeKutta::repeat_substep(const Interval& interval, const IntegratorOptions& options,
                                double t, double h, IntegrationResult* progress) {
  return_to_start();
  if (h == 0.0) return true;
  IntegratorOptions whatever = options;
  whatever.tolerance = 0.0;
  RemainingInterval left(t, h);
  IntegrationResult repeated;
  const double step = step_;
  const bool is_done = advance_substep(interval, whatever, &left, &repeated);
  step_ = step;
  ++progress->repeated;
  progress->evaluations += repeated.evaluations;
  return is_done && repeated.rejected == 0;
}

// Whether the island is too stiff even to try a few intervals.
bool RungeKutta::is_far_too_stiff(const IntegratorOptions& options) {
  const double most =
      options.tolerance > 0.0 ? kFarTooStiff * options.most_frequency : options.most_frequency;
  return std::isfinite(most) && equations_.frequency() > most;
}

IntegrationResult RungeKutta::start(const Interval& interval, const IntegratorOptions& options,
                                    const StageMemory& memory) {
  IntegrationResult progress;
  const double before = kinetic_energy(equations_, memory.state());
  has_started_ = equations_.start(interval.t, memory.state(), memory.derivatives());
  progress.projected = before - kinetic_energy(equations_, memory.state());
  equations_.take_projected_energy();  // part of `projected`
  progress.is_inconsistent = !has_started_;
  if (std::isfinite(options.most_projected))
    has_started_ = has_started_ && progress.projected <= options.most_projected * before;
  if (!has_started_) progress.rejected = 1;
  progress.is_stiff = has_started_ && is_far_too_stiff(options);
  has_started_ = has_started_ && !progress.is_stiff;
  progress.done = has_started_;
  return progress;
}

IntegrationResult RungeKutta::integrate_equations(const StageMemory& memory,
                                                  const Interval& interval,
                                                  const IntegratorOptions& options) {
  return with_system([&](auto& system) {
    return integrate(system, memory, interval.t, interval.h, options, interval.stop, step_);
  });
}

}  // namespace constraint_sim::engine
