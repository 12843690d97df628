#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>

#include "engine/dynamics/regularized_rows.h"
#include "engine/math/list.h"

namespace constraint_sim::engine {

/// The bodies of an island as one rigid body that has their mass, momenta and inertia.
struct RigidMotion {
  double mass = 0.0;                                   ///< [kg]
  Eigen::Vector3d centre = Eigen::Vector3d::Zero();    ///< of mass, world [m]
  Eigen::Vector3d velocity = Eigen::Vector3d::Zero();  ///< of the centre, world [m/s]
  Eigen::Vector3d momentum = Eigen::Vector3d::Zero();  ///< angular, about the centre [kg m²/s]
  Eigen::Matrix3d inverse_inertia = Eigen::Matrix3d::Zero();  ///< about the centre, world

  Eigen::Vector3d angular_velocity() const { return inverse_inertia * momentum; }
  Eigen::Vector3d velocity_at(const Eigen::Vector3d& position) const {
    return velocity + angular_velocity().cross(position - centre);
  }
  /// [J]
  double kinetic_energy() const {
    return 0.5 * (mass * velocity.squaredNorm() + momentum.dot(angular_velocity()));
  }
};

/// Bodies as EquationsOfMotion has them, those that turn first: masses, principal inertias of those
/// that turn, and where and how they move in the world. Points in a line do not turn about it.
RigidMotion as_one_body(const List<double>& mass, const List<Eigen::Vector3d>& inertia,
                        const List<Eigen::Vector3d>& position,
                        const List<Eigen::Quaterniond>& orientation, const BodyVectors& velocity);

}  // namespace constraint_sim::engine
