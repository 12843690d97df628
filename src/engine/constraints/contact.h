#pragma once

#include <Eigen/Core>

#include "constraint_sim/engine/body.h"
#include "constraint_sim/engine/contact.h"
#include "engine/constraints/row.h"

namespace constraint_sim::engine {

// Rows of a contact point p: the normal n (from B to A), and with friction two tangents. With arms
// r from the centres to p:
//   C = −depth,  J = (n, r_A × n, −n, −r_B × n),  p_n ≥ 0,  ‖p_t‖ ≤ μ p_n

inline constexpr int kMaxContactRows = 3;

/// Returns a unit vector at right angles to n, a function of n alone.
Eigen::Vector3d tangent_to(const Eigen::Vector3d& n);

/// Coefficients of a convex shape of a body, by the number of the part.
double friction_of(const Body& body, int part);
double restitution_of(const Body& body, int part);

/// Friction and restitution of two convex shapes of different bodies, by the numbers of the parts.
struct ContactSurface {
  double friction;     ///< geometric mean of both coefficients
  double restitution;  ///< larger of both coefficients

  ContactSurface(const Body& a, int part_a, const Body& b, int part_b);
};

/// Share of the fall of a step within which converged contacts rest: well above the residual.
inline constexpr double kConvergedRest = 1e-5;

struct ContactStep {
  double h;        ///< length of the step [s]
  double beta;     ///< share of the penetration removed per step
  double gravity;  ///< [m/s²]; the speed and the fall of a step count as rest
  /// Whether rows are solved to a tolerance, so that contacts at rest do not need to sink in, and
  /// bodies with a gap may come as near as the gap allows.
  bool is_converged = false;
};

/// Speed below which a converged contact rests [m/s].
inline double rest_speed(const ContactStep& step) { return kConvergedRest * step.gravity * step.h; }

/// Writes the rows of a contact point, the normal first, and returns their number, 1 without
/// friction. `impulse` is the impulse on A of the previous step, world [N s], for warm starting.
int write_contact_rows(const BodyState& a, const BodyState& b, const Eigen::Vector3d& normal,
                       const Manifold::Point& point, const ContactSurface& surface,
                       const ContactStep& step, const Eigen::Vector3d& impulse, Row* rows);

}  // namespace constraint_sim::engine
