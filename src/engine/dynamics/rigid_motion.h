#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>

#include "engine/dynamics/regularized_rows.h"
#include "engine/math/list.h"

namespace constraint_sim::engine {

/// Rigid body with the mass, momenta and inertia of all bodies of an island.
struct RigidMotion {
  double mass = 0.0;                                   ///< [kg]
  Eigen::Vector3d centre = Eigen::Vector3d::Zero();    ///< Centre of mass, world [m]
  Eigen::Vector3d velocity = Eigen::Vector3d::Zero();  ///< Velocity of the centre, world [m/s]
  /// Angular momentum about the centre [kg m²/s]
  Eigen::Vector3d momentum = Eigen::Vector3d::Zero();
  Eigen::Matrix3d inverse_inertia = Eigen::Matrix3d::Zero();  ///< About the centre, world axes

  Eigen::Vector3d angular_velocity() const { return inverse_inertia * momentum; }
  Eigen::Vector3d velocity_at(const Eigen::Vector3d& position) const {
    return velocity + angular_velocity().cross(position - centre);
  }
  /// Kinetic energy [J].
  double kinetic_energy() const {
    return 0.5 * (mass * velocity.squaredNorm() + momentum.dot(angular_velocity()));
  }
};

/// Combines bodies in the order of EquationsOfMotion, rotating bodies first: masses, principal
/// inertias of rotating bodies, poses and velocities in the world. Points in a line get no spin
/// about the line.
RigidMotion as_one_body(const List<double>& mass, const List<Eigen::Vector3d>& inertia,
                        const List<Eigen::Vector3d>& position,
                        const List<Eigen::Quaterniond>& orientation, const BodyVectors& velocity);

}  // namespace constraint_sim::engine
