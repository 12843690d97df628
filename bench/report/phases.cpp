#include "phases.h"

#include <cmath>

#include "problems.h"

namespace constraint_sim::report {
namespace {

using engine::problems::integrate;

/// Returns the share of a step after which the phase ends, by bisection.
Real share_until(const Phase& phase, const Reals& y, Real step) {
  Real low = 0, high = 1;
  for (int i = 0; i < 80; ++i) {
    const Real middle = (low + high) / 2;
    (phase.until(integrate(phase.rates, y, middle * step, 1)) < 0 ? high : low) = middle;
  }
  return high;
}

/// Advances by `duration`, through all phases within it.
void advance(Real duration, Real longest, Phase* phase, Reals* y) {
  constexpr int kMostPhases = 1000;
  for (int i = 0; i < kMostPhases;) {
    const Real step = std::min(duration, longest);
    if (step <= 0) return;
    Reals after = integrate(phase->rates, *y, step, 1);
    const bool ends = phase->until && phase->until(after) < 0;
    const Real share = ends ? share_until(*phase, *y, step) : 1;
    *y = ends ? integrate(phase->rates, *y, share * step, 1) : std::move(after);
    duration -= share * step;
    if (!ends) continue;
    Reals start;
    *phase = phase->next(*y, &start);
    *y = std::move(start);
    ++i;
  }
  throw std::runtime_error("a reference has events without end");
}

}  // namespace

std::function<Trajectory(int)> motion_in_phases(const Problem& problem, const Phase& first,
                                                const Reals& start, double step) {
  const int samples = problem.samples();
  const double interval = problem.sample;
  return [=](int refinement) {
    Phase phase = first;
    Reals y = start;
    Trajectory trajectory{phase.states(y)};
    for (int k = 1; k <= samples; ++k) {
      advance(static_cast<Real>(interval), static_cast<Real>(step) / refinement, &phase, &y);
      trajectory.push_back(phase.states(y));
    }
    return trajectory;
  };
}

Phase flight(const Problem& problem) {
  const std::vector<Body> bodies = problem.bodies;
  const Eigen::Vector3d g = problem.gravity;
  const std::size_t n = 3 * bodies.size();
  Phase phase;
  phase.rates = [=](const Reals& y) {
    Reals rates(y.begin() + static_cast<std::ptrdiff_t>(n), y.end());
    for (std::size_t i = 0; i < n; ++i)
      rates.push_back(
          static_cast<Real>(bodies[i / 3].is_static ? 0.0 : g[static_cast<Eigen::Index>(i % 3)]));
    return rates;
  };
  phase.states = [=](const Reals& y) {
    States states;
    for (std::size_t b = 0; b < bodies.size(); ++b) {
      states.push_back(bodies[b].start);
      for (std::size_t k = 0; k < 3; ++k) {
        const auto axis = static_cast<Eigen::Index>(k);
        states.back().position[axis] = static_cast<double>(y[3 * b + k]);
        states.back().velocity[axis] = static_cast<double>(y[n + 3 * b + k]);
      }
    }
    return states;
  };
  return phase;
}

}  // namespace constraint_sim::report
