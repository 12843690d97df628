#include "engine/methods/event_driven/joints/event_decision.h"

#include <algorithm>
#include <cmath>

#include "engine/math/box_lcp.h"
#include "engine/math/dense.h"
#include "engine/methods/event_driven/joints/event_driven.h"
#include "engine/methods/event_driven/law_events.h"
#include "engine/methods/event_driven/position_motor.h"

namespace constraint_sim::engine {
namespace {

using Eigen::Index;
using Eigen::VectorXd;

constexpr double kNoAcceleration = 1e-10;       // share of the largest acceleration; less is zero
constexpr double kNoAccelerationAlone = 1e-12;  // [m/s² or rad/s²] less is zero where nothing pulls

/// Coordinate that moves at the rate of a law that may hold it.
struct HoldCandidate {
  std::size_t law;
  Hold hold;
  double rate, acceleration;
  double zeta;  ///< rate that the motor demands
  ForceBounds bounds;
};

// Returns the law that may hold a coordinate, with its rate. Sets the other acting forces in
// `state`. `is_pressed`: the motor is too weak to leave a limit.
std::optional<HoldCandidate> candidate(const EventMotions& motions, std::size_t c,
                                       const EventProblem& problem, double t, bool is_pressed,
                                       OneSidedState* state) {
  const OneSidedLaw& law = motions.laws()[c];
  const EventReading& reading = problem.reading(c);
  const auto limit_of = [&](bool upper_one) { return motions.limit(c, upper_one, t); };
  const auto zeta_of = [&] { return motions.zeta(c, t, reading.q); };
  const HoldRules rules{problem.resting(), law.goal ? motions.braking(c) : 0.0, !is_pressed};
  const std::optional<Hold> hold =
      find_hold(law, motions.states()[c], reading, limit_of, zeta_of, rules, state);
  if (!hold) return std::nullopt;
  const Prescribed at = *hold == Hold::kBrake
                            ? braking_from(*law.goal, reading.rate, motions.braking(c))
                            : rate_held_at(*hold, limit_of, zeta_of);
  const Prescribed zeta = zeta_of();
  return HoldCandidate{
      c, *hold, at.rate, at.acceleration, zeta.rate, force_bounds(law, *hold, at, zeta)};
}

// Adds values of the laws that act to values of all laws.
void add_by_acting(const EventProblem& problem, const VectorXd& values, VectorXd* all) {
  for (const std::size_t c : problem.acting()) (*all)[eigen_index(c)] += values[problem.column(c)];
}

// Finds the coordinates that may be held, and the accelerations without forces that hold them.
// Returns false where a limit of unlimited force would yield.
bool find_candidates(const EventMotions& motions, const EventProblem& problem, double t,
                     const List<char>& is_pressed, List<HoldCandidate>* candidates,
                     EventDecision* next) {
  const List<OneSidedLaw>& laws = motions.laws();
  next->states.assign(laws.size(), {});
  next->leaves.assign(laws.size(), 0);
  VectorXd force = VectorXd::Zero(eigen_index(problem.acting().size()));
  for (const std::size_t c : problem.acting()) {
    if (motions.is_broken(laws[c].joint)) continue;
    OneSidedState& state = next->states[c];
    double& of_law = force[problem.column(c)];
    if (laws[c].has_servo())
      of_law = clamped_servo_force(laws[c], problem.reading(c), motions.rest(c, t));
    if (!problem.is_free(c)) continue;
    const auto found = candidate(motions, c, problem, t, is_pressed[c] != 0, &state);
    if (state.yield != 0 && !std::isfinite(laws[c].limit_force)) return false;
    if (found)
      candidates->push_back(*found);
    else
      of_law += constant_force(laws[c], state);
  }
  next->acceleration.resize(eigen_index(laws.size()));
  for (std::size_t c = 0; c < laws.size(); ++c)
    next->acceleration[eigen_index(c)] = problem.reading(c).acceleration;
  add_by_acting(problem, math::product(problem.A(), force), &next->acceleration);
  return true;
}

// Accelerations of candidates beside those that hold them, per force, with bounds of the forces.
BoxLcp problem_of(const List<HoldCandidate>& candidates, const EventProblem& all,
                  const VectorXd& acceleration) {
  const Index n = eigen_index(candidates.size());
  BoxLcp problem{Eigen::MatrixXd(n, n), VectorXd(n), VectorXd(n), VectorXd(n)};
  for (Index i = 0; i < n; ++i) {
    const HoldCandidate& row = candidates[i];
    for (Index j = 0; j < n; ++j) problem.A(i, j) = all.A(row.law, candidates[j].law);
    problem.b[i] = acceleration[eigen_index(row.law)] - row.acceleration;
    problem.least[i] = row.bounds.least;
    problem.most[i] = row.bounds.most;
  }
  return problem;
}

bool is_at_bound(const HoldCandidate& row, double lambda) {
  return !(lambda > row.bounds.least && lambda < row.bounds.most);
}

// Side to which each candidate leaves its rate; 0: it keeps the rate.
List<signed char> sides_of(const List<HoldCandidate>& candidates, const BoxLcp& problem,
                           const VectorXd& lambda, const EventRelease& release,
                           double largest_force) {
  const VectorXd a = problem.b + math::product(problem.A, lambda);
  const VectorXd roots = problem.A.diagonal().cwiseSqrt();
  const double largest = problem.b.cwiseQuotient(roots).lpNorm<Eigen::Infinity>();
  List<signed char> sides;
  for (Index i = 0; i < a.size(); ++i) {
    const HoldCandidate& row = candidates[i];
    const bool is_leaving =
        std::abs(a[i]) > std::max(kNoAcceleration * largest * roots[i], kNoAccelerationAlone);
    signed char side = is_leaving ? sign_of(a[i]) : sign_of(0.0);
    const double bound = release.side < 0 ? row.bounds.least : row.bounds.most;
    if (side == 0 && release.law == static_cast<int>(row.law) &&
        std::abs(lambda[i] - bound) <=
            kAtBound * std::max({std::abs(bound), std::abs(lambda[i]), largest_force}))
      side = static_cast<signed char>(-release.side);
    sides.push_back(side);
  }
  return sides;
}

// Decides once, with `is_pressed` per law: its motor is too weak to leave a limit.
bool decide_once(const EventMotions& motions, const EventProblem& all, double t,
                 const EventRelease& release, double largest_force, const List<char>& is_pressed,
                 EventDecision* next) {
  List<HoldCandidate> candidates;
  if (!find_candidates(motions, all, t, is_pressed, &candidates, next) ||
      candidates.size() > EventDriven::kMostRows)
    return false;
  const Index n = eigen_index(candidates.size());
  if (n == 0) return true;
  const BoxLcp problem = problem_of(candidates, all, next->acceleration);
  VectorXd lambda;
  if (!solve(problem, &lambda)) return false;
  for (Index i = 0; i < n; ++i)
    add_by_acting(all, lambda[i] * all.A().col(all.column(candidates[i].law)), &next->acceleration);
  const List<signed char> sides = sides_of(candidates, problem, lambda, release, largest_force);
  List<Index> held;
  for (Index i = 0; i < n; ++i)
    if (sides[i] == 0 && !is_at_bound(candidates[i], lambda[i])) held.push_back(i);
  for (Index i = 0; i < n; ++i) {
    const HoldCandidate& row = candidates[i];
    OneSidedState& state = next->states[row.law];
    const auto leave = [&](signed char side) {
      state = state_leaving(motions.laws()[row.law], row.hold, row.rate, row.zeta, side);
    };
    if (sides[i] != 0) {
      leave(sides[i]);
      next->leaves[row.law] = 1;
    } else if (!is_at_bound(row, lambda[i])) {
      state.hold = row.hold;
    } else if (pivot_beside(problem.A, held, i) > kDependent) {
      held.push_back(i);
      state.hold = row.hold;
    } else {  // dependent on the held rows, which hold the coordinate for now
      leave(lambda[i] > row.bounds.least ? -1 : 1);
    }
  }
  return true;
}

// Marks the motors that are too weak to leave a limit in the decided states. Returns whether there
// are further ones.
bool find_pressed(const EventMotions& motions, const EventProblem& problem, double t,
                  const EventDecision& next, List<char>* presses) {
  const List<OneSidedLaw>& laws = motions.laws();
  bool any = false;
  for (std::size_t c = 0; c < laws.size(); ++c) {
    if ((*presses)[c] || !laws[c].goal || next.states[c].drive == 0 || motions.braking(c) > 0.0 ||
        !is_pressed(laws[c], problem.reading(c).q, next.acceleration[eigen_index(c)],
                    [&](bool upper_one) { return motions.limit(c, upper_one, t); }))
      continue;
    (*presses)[c] = 1;
    any = true;
  }
  return any;
}

}  // namespace

std::optional<EventDecision> decide(const EventMotions& motions, const EventProblem& problem,
                                    double t, const EventRelease& release, double largest_force) {
  const List<OneSidedLaw>& laws = motions.laws();
  EventDecision next;
  List<char> is_pressed(laws.size(), 0);
  for (std::size_t pass = 0; pass <= laws.size(); ++pass) {
    if (!decide_once(motions, problem, t, release, largest_force, is_pressed, &next))
      return std::nullopt;
    if (!find_pressed(motions, problem, t, next, &is_pressed)) break;
  }
  for (std::size_t c = 0; c < laws.size(); ++c) {
    if (!laws[c].has_servo() || motions.is_broken(laws[c].joint)) continue;
    EventReading now = problem.reading(c);
    now.acceleration = next.acceleration[eigen_index(c)];
    next.states[c].servo = servo_from(laws[c], motions.states()[c].servo, now, motions.rest(c, t));
  }
  return next;
}

}  // namespace constraint_sim::engine
