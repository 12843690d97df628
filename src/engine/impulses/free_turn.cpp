#include "engine/impulses/free_turn.h"

#include <Eigen/LU>

#include "engine/math/elementary.h"

namespace constraint_sim::engine {
namespace {

using Eigen::Matrix3d;
using Eigen::Quaterniond;
using Eigen::Vector3d;

// Square of the last correction of Newton's method, as a share of the square of the angular
// momentum: the correction is at its rounding, 1e-15.
constexpr double kMomentumFound = 1e-30;

// Rotates a body for h without torque. With L' = L_B × ω in the body frame, a rotation about I⁻¹
// (L₀ + L₁) from L₀ to L₁ conserves the energy and L in the world exactly; the angle is that of a
// uniform rotation. Newton's method finds L₁. A body that rotates too far in one step for that
// rotates about L.
void turn(const MassProperties& mass, double h, BodyState* body) {
  const Quaterniond q_0 = body->orientation;
  const Vector3d w = q_0.conjugate() * body->angular_velocity;
  const Vector3d L_0 = mass.inertia.cwiseProduct(w);
  const Vector3d L_W = q_0 * L_0;
  const double speed = w.norm();
  const double half_angle = 0.5 * h * speed;
  bool is_found = false;
  Vector3d half_turn;  // axis of the step in the body frame, with length tan of half the angle
  if (half_angle < 1.0) {
    const auto [sine, cosine] = math::sin_cos(half_angle);
    const double scale = half_angle > 1e-4 ? sine / (cosine * speed)
                                           : 0.5 * h * (1.0 + half_angle * half_angle / 3.0);
    const auto cross = [](const Vector3d& x) {
      Matrix3d m;
      m << 0.0, -x.z(), x.y(), x.z(), 0.0, -x.x(), -x.y(), x.x(), 0.0;
      return m;
    };
    Vector3d mean = L_0;  // ½ (L₀ + L₁)
    for (int step = 0; step < 8 && !is_found; ++step) {
      const Vector3d w_mean = mass.inverse_inertia.cwiseProduct(mean);
      const Vector3d error = mean - L_0 - scale * mean.cross(w_mean);
      const Matrix3d derivative =
          Matrix3d::Identity() +
          scale * (cross(w_mean) - cross(mean) * mass.inverse_inertia.asDiagonal());
      const Vector3d change = derivative.inverse() * error;
      mean -= change;
      is_found = change.squaredNorm() <= kMomentumFound * L_0.squaredNorm();
    }
    half_turn = scale * mass.inverse_inertia.cwiseProduct(mean);
  }
  if (is_found) {
    const Quaterniond turned(1.0, half_turn.x(), half_turn.y(), half_turn.z());
    body->orientation = (q_0 * turned).normalized();
  } else {
    const Vector3d axis = L_W.normalized();
    body->orientation = (rotation(h * body->angular_velocity.dot(axis) * axis) * q_0).normalized();
  }
  body->angular_velocity = apply_inertia(mass.inverse_inertia, body->orientation, L_W);
}

}  // namespace

void advance_orientation(const MassProperties& mass, double h, BodyState* body) {
  if (body->angular_velocity.isZero(0.0)) return;
  if (mass.can_turn() && !mass.is_isotropic())
    turn(mass, h, body);
  else
    body->orientation = (rotation(h * body->angular_velocity) * body->orientation).normalized();
}

void advance_kinematic(const List<int>& moved, double h, List<BodyState>& bodies) {
  for (const int i : moved) {
    bodies[i].position += h * bodies[i].linear_velocity;
    advance_orientation(MassProperties{}, h, &bodies[i]);
  }
}

}  // namespace constraint_sim::engine
