#pragma once

#include <Eigen/Core>

#include "engine/constraints/custom_code.h"
#include "engine/dynamics/coordinate_positions.h"
#include "engine/dynamics/interval_inputs.h"
#include "engine/dynamics/island_model.h"
#include "engine/dynamics/kinematics.h"
#include "engine/math/list.h"

namespace constraint_sim::engine {

// Joints that act by forces of their own instead of rows. Each function adds to the acceleration
// per point [m/s²] and to the torque per rotating body [N m].

/// Adds the forces of springs and writes them to `forces`, spring by spring [N].
void add_spring_forces(const IslandModel& island, const IntervalInputs& inputs,
                       const Kinematics& kinematics, double* forces,
                       List<Eigen::Vector3d>* acceleration, List<Eigen::Vector3d>* torque);
/// Adds the forces along soft coordinates and writes them to `forces`, coordinate by coordinate.
void add_soft_forces(const IslandModel& island, const Kinematics& kinematics,
                     const CoordinatePositions& coordinates, double* forces,
                     List<Eigen::Vector3d>* acceleration, List<Eigen::Vector3d>* torque);
/// Calls `act(point, force, torque)` for both ends of each joint of a custom kind with forces of
/// its own, at time t [s].
template <class Act>
void for_each_custom_force(const IslandModel& island, const Kinematics& kinematics, double t,
                           const Act& act) {
  for (std::size_t l = island.first().general; l < island.first().spring; ++l) {
    const IslandModel::Link& link = island.links()[l];
    if (!link.has_custom_force()) continue;
    const Jacobian wrench = link.custom->wrench(t, kinematics.vectors(l), kinematics.motion(l));
    act(link.a, wrench.j1, wrench.j2);
    act(link.b, wrench.j3, wrench.j4);
  }
}

}  // namespace constraint_sim::engine
