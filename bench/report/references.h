#pragma once

// Motions independent of all engines: closed forms, and minimal coordinates in long double.

#include <functional>
#include <vector>

#include "long_double_reference.h"
#include "problem.h"

namespace constraint_sim::report {

/// Returns states(t) at all sample times of the problem.
std::function<Trajectory(int)> closed_form(const Problem& problem,
                                           const std::function<States(long double t)>& states);

/// Point masses on rods from the origin, in the x-z plane, with initial angles from the x axis and
/// their rates. `step` [s] is that of the integration.
struct PlanarChain {
  std::vector<double> masses, lengths, angles, rates;
  double gravity = 9.81;
};
/// Adds the chain as bodies and rods in their initial state.
void add_chain(const PlanarChain& chain, Problem* problem);
std::function<Trajectory(int)> chain_motion(const Problem& problem, const PlanarChain& chain,
                                            double step);

/// Motion of a rigid body about `pivot` in its own frame, or, if free, about its centre of mass,
/// which follows a parabola. Integrates quaternion and body rates.
std::function<Trajectory(int)> rigid_motion(const Problem& problem, bool is_free,
                                            const Eigen::Vector3d& pivot, double step);

/// Motion of one angle θ from the x axis with θ̈ = a cos θ + b sin θ, from which `states` makes all
/// bodies.
std::function<Trajectory(int)> one_angle(
    const Problem& problem, double a, double b, double angle, double rate, double step,
    const std::function<States(long double angle, long double rate)>& states);

/// Returns bodies, joints with axes and free lengths of a problem for the dense reference, with or
/// without couplings; other joints are left out.
engine::reference::Scene axes_of(const Problem& problem, bool with_couplings);

/// Motion of bodies on joints with axes and couplings, by the dense reference in long double:
/// extrapolation to a tolerance that `refinement` divides by a thousand.
std::function<Trajectory(int)> mechanism_motion(const Problem& problem);

}  // namespace constraint_sim::report
