#pragma once

// How wrong a motion is, from its sampled states alone, the same way for every engine.

#include "problem.h"

namespace constraint_sim::report {

/// Largest over the samples and bodies. NaN where there is nothing to compare with.
struct Errors {
  double position;     ///< distance of a centre of mass from the reference [m]
  double orientation;  ///< angle from the reference, of bodies that rotate [rad]
  double energy;       ///< change of the energy over its scale [1]
  double momentum;  ///< of all bodies from the reference over its largest there, linear or angular
                    ///< about the origin, whichever is worse [1]
  /// Of rods and joints, whatever is asked of springs; angles of axes times the radius of gyration
  /// of the larger body [m].
  double constraint;
  double penetration;  ///< of spheres and boxes into planes and of spheres into each other [m]
};

/// Kinetic energy, and that of gravity, constant forces and springs [J].
double energy(const Problem& problem, const States& states);
double kinetic_energy(const Problem& problem, const States& states);
/// Largest |error| of the rods, motors included, and joints at time t [m].
double constraint_error(const Problem& problem, const States& states, double time);
double penetration(const Problem& problem, const States& states);
/// The angle of the rotation from one orientation to the other [rad], 0 to π.
double angle_between(const Eigen::Quaterniond& a, const Eigen::Quaterniond& b);
bool is_finite(const States& states);

/// A measured motion; `sample` says which of the reference's samples each entry is.
struct Motion {
  std::vector<int> sample;
  Trajectory states;
};
Errors errors(const Problem& problem, const Motion& motion, const Trajectory& reference);

/// By how much two references of one problem differ at most [m], rotations times the length.
double largest_difference(const Problem& problem, const Trajectory& a, const Trajectory& b);

}  // namespace constraint_sim::report
