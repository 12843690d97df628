#pragma once

#include <Eigen/Core>

#include "constraint_sim/engine/body.h"
#include "constraint_sim/engine/contact.h"
#include "constraint_sim/engine/row.h"

namespace constraint_sim::engine {

// A contact point p: one row along the normal n (from B to A), and with friction two along the
// tangents. With r the arms from the centres to p:
//   C = −depth,  J = (n, r_A × n, −n, −r_B × n),  p_n ≥ 0,  ‖p_t‖ ≤ μ p_n

inline constexpr int kMaxContactRows = 3;

/// A unit vector at right angles to n, the same for the same n.
Eigen::Vector3d tangent_to(const Eigen::Vector3d& n);

/// How two surfaces act on each other.
struct ContactSurface {
  double friction;     ///< geometric mean of the two
  double restitution;  ///< the larger of the two

  ContactSurface(const Body& a, const Body& b);
};

struct ContactStep {
  double h;        ///< length of the step [s]
  double beta;     ///< share of the penetration pushed out per step
  double gravity;  ///< [m/s²]; its speed and fall in one step are what is let pass as rest
};

/// Writes the rows of one contact point, the normal first, and returns how many: without friction
/// only one. `impulse` is what held the point in the step before, on A, world [N s].
int write_contact_rows(const BodyState& a, const BodyState& b, const Eigen::Vector3d& normal,
                       const Manifold::Point& point, const ContactSurface& surface,
                       const ContactStep& step, const Eigen::Vector3d& impulse, Row* rows);

}  // namespace constraint_sim::engine
