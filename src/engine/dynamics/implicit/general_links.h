#pragma once

#include "engine/dynamics/implicit/form_in_step.h"
#include "engine/dynamics/implicit/implicit_motion.h"
#include "engine/dynamics/implicit/implicit_system.h"
#include "engine/dynamics/implicit/link_in_step.h"

namespace constraint_sim::engine {

/// Adds the rows of a general joint, and a custom force, to the equations of a step. Forces and
/// torques are λ times the Jacobian where forces are taken: for the midpoint rule at the mean
/// vectors, which gives the discrete gradient. Sets the force in `state` and the ends of soft rows
/// in `softs`.
void evaluate_general_link(const ImplicitLink& link, const ImplicitMotion& motion,
                           const List<double>& unknowns, LinkInStep* state, List<SoftInStep>* softs,
                           ImplicitSystem* system);

/// Adds `weight` times a force on B, its opposite on A, and a torque to the equations of the body
/// at an end.
void add_load(const ImplicitEnd& end, double weight, const Eigen::Vector3d& force,
              const Eigen::Vector3d& torque, const ImplicitMotion& motion, ImplicitSystem* system);

/// Adds the derivatives of the force on end e of a link by the displacements of both ends.
void write_slopes(const ImplicitLink& link, std::size_t e, const ImplicitMotion& motion,
                  const std::array<JacobianSlopes, 2>& slopes, const ImplicitSystem& system,
                  ImplicitSystem::Entries* entries);

/// Response of the equations of the body at end e to a unit λ of a row with Jacobian J, times
/// −`weight`.
Eigen::Matrix<double, 6, 1> column_of(const ImplicitEnd& end, std::size_t e, double weight,
                                      const Jacobian& J, const ImplicitMotion& motion);

}  // namespace constraint_sim::engine
