#pragma once

// Errors of a motion, from its sampled states alone, in the same way for every engine.

#include "problem.h"

namespace constraint_sim::report {

/// Largest errors over samples and bodies. NaN where there is no reference.
struct Errors {
  double position;     ///< distance of a centre of mass from the reference [m]
  double orientation;  ///< angle to the reference, for bodies that rotate [rad]
  double energy;       ///< change of energy over its scale, dimensionless
  double momentum;     ///< error of the total linear or angular momentum about the origin, over its
                       ///< largest value in the reference; the larger one, dimensionless
  /// Error of rods and joints, not of springs [m]; angles of axes times the radius of gyration of
  /// the larger body.
  double constraint;
  double penetration;  ///< spheres and boxes into planes, spheres into each other [m]
};

/// Returns kinetic energy plus the potentials of gravity, constant forces and springs [J].
double energy(const Problem& problem, const States& states);
double kinetic_energy(const Problem& problem, const States& states);
/// Returns the largest |error| of rods, with motors, and joints at time t [m].
double constraint_error(const Problem& problem, const States& states, double time);
double penetration(const Problem& problem, const States& states);
/// Returns the angle of the rotation between two orientations [rad], 0 to π.
double angle_between(const Eigen::Quaterniond& a, const Eigen::Quaterniond& b);
bool is_finite(const States& states);

/// A measured motion; `sample` is the reference's sample of each entry.
struct Motion {
  std::vector<int> sample;
  Trajectory states;
};
Errors errors(const Problem& problem, const Motion& motion, const Trajectory& reference);

/// Returns the largest difference of two references of a problem [m], rotations times the length.
double largest_difference(const Problem& problem, const Trajectory& a, const Trajectory& b);

}  // namespace constraint_sim::report
