#include "engine/impulses/free_turn.h"

#include <algorithm>
#include <cmath>

#include "engine/math/elementary.h"

namespace constraint_sim::engine {
namespace {

using Eigen::Quaterniond;
using Eigen::Vector3d;

// Error of Newton's method that is left, as a share of the angular momentum: a tenth of its
// rounding.
constexpr double kMomentumSolved = 1e-17;
// Newton's method starts from two fixed-point iterations, not from L₀, up to this relative change
// of the angular momentum in the body frame in half a step.
constexpr double kSlowTurn = 0.1;

// Equations of the mean angular momentum x in the body frame: x − s x × (I⁻¹ x) = L₀.
struct MeanMomentum {
  // s times differences of the inverse moments, so that s x × (I⁻¹ x) has the components kx x_y
  // x_z, ky x_z x_x and kz x_x x_y.
  double kx, ky, kz;
  Vector3d L_0;

  double largest_coefficient() const {
    return std::max(std::abs(kx), std::max(std::abs(ky), std::abs(kz)));
  }

  // x by the equations, from an approximation of x.
  Vector3d next(const Vector3d& x) const {
    return L_0 + Vector3d(kx * x.y() * x.z(), ky * x.z() * x.x(), kz * x.x() * x.y());
  }

  // Newton's correction of x, by the adjugate of the derivative [1 p q; r 1 t; u v 1].
  Vector3d correction(const Vector3d& x) const {
    const double p = -kx * x.z(), q = -kx * x.y(), r = -ky * x.z();
    const double t = -ky * x.x(), u = -kz * x.y(), v = -kz * x.x();
    const Vector3d e = x - next(x);
    const Vector3d adjugate_e((1.0 - t * v) * e.x() + (q * v - p) * e.y() + (p * t - q) * e.z(),
                              (t * u - r) * e.x() + (1.0 - q * u) * e.y() + (q * r - t) * e.z(),
                              (r * v - u) * e.x() + (p * u - v) * e.y() + (1.0 - p * r) * e.z());
    const double determinant = 1.0 - t * v + p * (t * u - r) + q * (r * v - u);
    return adjugate_e / determinant;
  }
};

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
    // Below 1e-4 the series to second order is exact up to rounding.
    const double scale = half_angle > 1e-4 ? sine / (cosine * speed)
                                           : 0.5 * h * (1.0 + half_angle * half_angle / 3.0);
    const Vector3d& j = mass.inverse_inertia;
    const MeanMomentum equations{scale * (j.z() - j.y()), scale * (j.x() - j.z()),
                                 scale * (j.y() - j.x()), L_0};
    const double L = L_0.norm(), k = equations.largest_coefficient();
    Vector3d mean = L_0;  // ½ (L₀ + L₁)
    if (k * L < kSlowTurn) mean = equations.next(equations.next(L_0));
    for (int step = 0; step < 8 && !is_found; ++step) {
      const Vector3d change = equations.correction(mean);
      mean -= change;
      // Newton converges quadratically: estimated error after this step.
      is_found = k * change.squaredNorm() <= kMomentumSolved * L;
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
