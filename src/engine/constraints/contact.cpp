#include "engine/constraints/contact.h"

#include <algorithm>
#include <cmath>

namespace constraint_sim::engine {
namespace {

using Eigen::Vector3d;

// Yielding of contacts. Bodies that are squeezed between others have no rigid correction, and would
// leave to the side by whatever tilt rounding has.
constexpr double kYielding = 1e-4;

// Jacobian of the velocity of A relative to B at p along n.
Jacobian jacobian(const BodyState& a, const BodyState& b, const Vector3d& p, const Vector3d& n) {
  return {n, (p - a.position).cross(n), -n, -(p - b.position).cross(n)};
}

// Sets target and correction of the normal row. An approach faster than rest bounces. Baumgarte
// removes the penetration beyond a slop of g h², the fall of one step: without it contacts at rest
// would open and close. Where rows are solved to a tolerance, a small share of it is enough.
void aim_normal(Row* row, double approach, double depth, const ContactSurface& surface,
                const ContactStep& step) {
  const double fall = step.gravity * step.h * step.h;
  const double slop = step.is_converged ? kConvergedRest * fall : fall;
  const double rest_speed = 2.0 * step.gravity * step.h;
  const double push_out = step.beta / step.h * std::max(depth - slop, 0.0);
  row->target = approach > rest_speed ? surface.restitution * approach : 0.0;
  row->correction = std::max(push_out - row->target, 0.0);
  if (step.is_converged && depth < 0.0 && (row->target == 0.0 || approach * step.h < -depth))
    row->target = depth / step.h;
}

}  // namespace

Vector3d tangent_to(const Vector3d& n) {
  Eigen::Index least = 0;
  n.cwiseAbs().minCoeff(&least);
  return n.cross(Vector3d::Unit(least)).normalized();
}

double friction_of(const Body& body, int part) {
  const ShapePart* found = find_part(body.shape, part);
  return found == nullptr ? body.friction : found->friction.value_or(body.friction);
}

double restitution_of(const Body& body, int part) {
  const ShapePart* found = find_part(body.shape, part);
  return found == nullptr ? body.restitution : found->restitution.value_or(body.restitution);
}

ContactSurface::ContactSurface(const Body& a, int part_a, const Body& b, int part_b)
    : friction(std::sqrt(friction_of(a, part_a) * friction_of(b, part_b))),
      restitution(std::max(restitution_of(a, part_a), restitution_of(b, part_b))) {}

int write_contact_rows(const BodyState& a, const BodyState& b, const Vector3d& normal,
                       const Manifold::Point& point, const ContactSurface& surface,
                       const ContactStep& step, const Vector3d& impulse, Row* rows) {
  Row& row = rows[0];
  row.J = jacobian(a, b, point.position, normal);
  row.C = -point.depth;
  const double approach =
      -row.J.times(a.linear_velocity, a.angular_velocity, b.linear_velocity, b.angular_velocity);
  aim_normal(&row, approach, point.depth, surface, step);
  row.lower = 0.0;
  row.yielding = step.is_converged ? kYielding : 0.0;
  row.impulse = std::max(impulse.dot(normal), 0.0);
  if (surface.friction == 0.0) return 1;

  Vector3d tangent = tangent_to(normal);
  for (int k = 1; k <= 2; ++k) {
    rows[k].J = jacobian(a, b, point.position, tangent);
    rows[k].friction = surface.friction;
    rows[k].impulse = impulse.dot(tangent);
    tangent = normal.cross(tangent);
  }
  return 3;
}

}  // namespace constraint_sim::engine
