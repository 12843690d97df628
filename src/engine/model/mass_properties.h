#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <cmath>

#include "engine/math/elementary.h"

namespace constraint_sim::engine {

/// Mass properties of a body; zeros for immovable bodies.
struct MassProperties {
  double inverse_mass = 0.0;                          ///< [1/kg]
  Eigen::Vector3d inertia = Eigen::Vector3d::Zero();  ///< principal moments [kg m²]
  /// Principal inverse moments [1/(kg m²)].
  Eigen::Vector3d inverse_inertia = Eigen::Vector3d::Zero();
  double weight_share = 1.0;  ///< share of gravity that acts on the body

  bool is_movable() const { return inverse_mass > 0.0; }
  bool can_turn() const { return !inverse_inertia.isZero(0.0); }
  bool is_isotropic() const { return inertia.x() == inertia.y() && inertia.y() == inertia.z(); }
  /// Radius of gyration for the largest moment of inertia [m].
  double radius_of_gyration() const { return std::sqrt(inertia.maxCoeff() * inverse_mass); }
};

/// Returns R diag(principal) Rᵀ w for a body with orientation q; `w` and the result are in world
/// axes.
inline Eigen::Vector3d apply_inertia(const Eigen::Vector3d& principal, const Eigen::Quaterniond& q,
                                     const Eigen::Vector3d& w) {
  return q * principal.cwiseProduct(q.conjugate() * w);
}

/// Returns the rotation by the vector w [rad].
inline Eigen::Quaterniond rotation(const Eigen::Vector3d& w) {
  const double angle = w.norm();
  const auto [sine, cosine] = math::sin_cos(0.5 * angle);
  // Below 1e-4 the series of sin(x/2)/x to second order is exact up to rounding.
  const double s = angle > 1e-4 ? sine / angle : 0.5 - angle * angle / 48.0;
  Eigen::Quaterniond q;
  q.w() = cosine;
  q.vec() = s * w;
  return q;
}

/// Returns the rotation vector of q, with a norm in [0, π] [rad].
inline Eigen::Vector3d rotation_vector(const Eigen::Quaterniond& q) {
  const double sine = q.vec().norm(), sign = q.w() < 0.0 ? -1.0 : 1.0;
  // Squares of smaller sines underflow; their angle is twice the sine.
  const double stretch = sine > 1e-100 ? math::atan2(sine, std::abs(q.w())) / sine : 1.0;
  return 2.0 * sign * stretch * q.vec();
}

}  // namespace constraint_sim::engine
