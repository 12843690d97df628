#pragma once

#include "engine/dynamics/implicit/implicit_motion.h"
#include "engine/dynamics/implicit/joint_slopes.h"
#include "engine/dynamics/implicit/link_in_step.h"

namespace constraint_sim::engine {

/// Forces of a general joint: force on B, torques on A and B, and their derivatives by the
/// displacements of both ends.
struct GeneralForces {
  Eigen::Vector3d force = Eigen::Vector3d::Zero();
  std::array<Eigen::Vector3d, 2> torque{Eigen::Vector3d::Zero(), Eigen::Vector3d::Zero()};
  std::array<JacobianSlopes, 2> slopes;
};

/// Adds the custom force of a link. Its rates are those where the implicit step takes forces: Δx/h
/// at the midpoint, or (3 Δx − Δx₋)/2h by BDF2, with Δx the displacement in the step, Δx₋ before
/// it.
void add_custom_force(const ImplicitLink& link, const LinkInStep& state, const JointInStep& joint,
                      const ImplicitMotion& motion, const List<double>& unknowns,
                      GeneralForces* forces);

}  // namespace constraint_sim::engine
