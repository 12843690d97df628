#include "engine/math/proximal_equations.h"

#include <algorithm>
#include <cmath>

#include "engine/math/body_cone_blocks.h"

namespace constraint_sim::engine {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;

/// Returns the derivative of nearest_in_cone().
Matrix3d slope_of_nearest(const Vector3d& q, double mu) {
  const double n = q[0];
  const double t = std::sqrt(q[1] * q[1] + q[2] * q[2]);
  if (mu > 0.0 && t <= mu * n) return Matrix3d::Identity();
  if (mu * t <= -n) return Matrix3d::Zero();
  if (mu == 0.0 || t == 0.0) return Vector3d::UnitX().asDiagonal();
  const Vector3d along(1.0, mu * q[1] / t, mu * q[2] / t), across(0.0, -q[2] / t, q[1] / t);
  const double normal = (n + mu * t) / (1.0 + mu * mu);
  return along * along.transpose() / (1.0 + mu * mu) +
         mu * normal / t * across * across.transpose();
}

}  // namespace

ProximalImpulse proximal_impulse(const ProximalBlock& block, const Vector3d& x_k, Vector3d z,
                                 double sigma, bool with_slope) {
  ProximalImpulse result;
  if (block.is_contact) {
    const double slip = tangent_norm(z.data());
    Matrix3d shifted = Matrix3d::Identity();
    if (!block.shift && slip > 0.0)
      shifted.row(0).tail<2>() = block.friction / slip * z.tail<2>().transpose();
    z[0] += block.shift.value_or(block.friction * slip);
    const Vector3d q = x_k - sigma * z;
    result.x = nearest_in_cone(q, block.friction);
    if (with_slope) result.slope = sigma * slope_of_nearest(q, block.friction) * shifted;
  } else {
    const double yielding = 1.0 + sigma * block.softness;
    const double q = (x_k[0] - sigma * z[0]) / yielding;
    result.x[0] = std::clamp(q, block.least, block.most);
    if (with_slope && result.x[0] == q) result.slope(0, 0) = sigma / yielding;
    result.potential = -0.5 * block.softness * result.x[0] * result.x[0];
  }
  result.potential -= z.dot(result.x) + (result.x - x_k).squaredNorm() / (2.0 * sigma);
  return result;
}

}  // namespace constraint_sim::engine
