#include "engine/math/proximal_newton.h"

#include <algorithm>

namespace constraint_sim::engine {
namespace {

// Largest and least σ, and its growth after easy steps, before and after one has failed. Solved
// problems of random scenes ended between 1e3 and 1e8.
constexpr double kMostSigma = 1e9, kLeastSigma = 1e-6;
constexpr double kGrowth = 4.0, kCarefulGrowth = 2.0;
// Iterations of Newton's method in a proximal step, and the most of an easy one.
constexpr int kMostInner = 8, kMostOfEasy = 3;
// A proximal step ends where the gradient is at most this multiple of (x − x_k)/σ, both as norms of
// √energy, or at the rounding of its first value. The value is the one between 0.01 and 1000 by
// which most piles of balls were solved in 100 steps: the next step mends an error of the last.
constexpr double kInnerTolerance = 30.0, kInnerRounding = 1e-12;
// Line search: most halvings, with shifts held and not, since only a potential always decreases;
// and the decreases asked for, of the potential as a share of its slope, and of the square of the
// gradient, whose rounding is smaller, per share of the change. Without a potential, a step with
// less than a tenth of the square taken away has failed.
constexpr int kMostHalvingsHeld = 20, kMostHalvings = 5;
constexpr double kDecrease = 1e-3, kSquareDecrease = 0.2, kLeastSquareDecrease = 0.1;

}  // namespace

double ProximalNewton::solve(const Goal& goal, double residual, StopFlag stop,
                             ProximalEquations* equations, List<double>* p) {
  steps_ = 0;
  residual_ = residual;
  equations->begin(*p);
  iterate(goal, stop, equations);
  if (residual_ < residual) equations->get(p);
  return residual_;
}

void ProximalNewton::iterate(const Goal& goal, StopFlag stop, ProximalEquations* equations) {
  double sigma = goal.sigma, growth = kGrowth;
  const bool can_hold = equations->hold_shifts(true);
  bool has_switched = false;  // since the last step that did not fail
  is_held_ = can_hold;
  while (steps_ < goal.most_steps && sigma >= kLeastSigma && !is_set(stop)) {
    equations->keep_start();
    switch (step(goal, sigma, stop, equations)) {
      case End::kSolved:
        return;
      case End::kEasy:
        sigma = std::min(sigma * growth, kMostSigma);
        [[fallthrough]];
      case End::kHard:
        equations->take();
        has_switched = false;
        break;
      case End::kFailed:
        equations->return_to_start();
        if (can_hold) {
          equations->hold_shifts(is_held_ = !is_held_);
          has_switched = !has_switched;
          if (has_switched) break;
        }
        sigma /= growth;
        growth = kCarefulGrowth;
    }
  }
}

ProximalNewton::End ProximalNewton::step(const Goal& goal, double sigma, StopFlag stop,
                                         ProximalEquations* equations) {
  ProximalEquations::Merit merit = equations->evaluate(sigma, 0.0);
  const double rounding = kInnerRounding * kInnerRounding * merit.square;
  for (int k = 0;; ++k) {
    consider(equations);
    if (residual_ <= goal.residual) return End::kSolved;
    const double near = kInnerTolerance / sigma;
    if (k > 0 && merit.square <= std::max(near * near * equations->squared_distance(), rounding))
      return k <= kMostOfEasy ? End::kEasy : End::kHard;
    if (k == kMostInner || steps_ >= goal.most_steps || is_set(stop)) return End::kFailed;
    ++steps_;
    if (!equations->find_change(sigma)) return End::kFailed;
    const double slope = equations->slope();
    const ProximalEquations::Merit before = merit;
    const int most_halvings = is_held_ ? kMostHalvingsHeld : kMostHalvings;
    bool is_less = false;
    double share = 1.0;
    for (int halving = 0; halving <= most_halvings && !is_less; ++halving) {
      if (halving > 0) share *= 0.5;
      merit = equations->evaluate(sigma, share);
      is_less = merit.potential <= before.potential + kDecrease * share * slope ||
                merit.square <= (1.0 - kSquareDecrease * share) * before.square;
    }
    if (!is_held_) is_less = merit.square <= (1.0 - kLeastSquareDecrease) * before.square;
    if (!is_less) return End::kFailed;
    equations->move();
  }
}

// Keeps the impulses x where they are the best so far.
void ProximalNewton::consider(ProximalEquations* equations) {
  const double now = equations->residual();
  if (!(now < residual_)) return;
  residual_ = now;
  equations->keep();
}

}  // namespace constraint_sim::engine
