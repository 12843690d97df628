#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <vector>

#include "constraint_sim/engine/joint.h"
#include "urdf/lumps.h"

namespace constraint_sim {

/// Axis of a hinge or slider in the world.
struct JointAxis {
  Eigen::Vector3d point, direction;  ///< [m], unit vector
  bool is_slider = false;
};

/// Returns the mass [kg], or the moment of inertia about the axis [kg m²], of a lump and of all
/// lumps behind it on joints, at their present poses. `bodies` are those of the lumps.
double inertia_behind(const Lumps& lumps, const std::vector<engine::Body>& bodies, std::size_t lump,
                      const JointAxis& axis);

/// Replaces frequency and damping ratio of a servo by the stiffness and damping that give them to
/// this inertia [kg or kg m²]. Other motors stay.
void set_servo_gains(double inertia, engine::Motor* motor);

}  // namespace constraint_sim
