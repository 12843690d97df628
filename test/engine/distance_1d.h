#pragma once

namespace constraint_sim::engine {

// The tutorial's simplest constraint: two particles on a line, kept a length L apart. The tests
// compare it with the distance joint of a World.

/// C(x, y) = ½((x − y)² − L²) and its Jacobian (∂C/∂x, ∂C/∂y); Ċ = j_x ẋ + j_y ẏ.
struct Distance1d {
  double C;    ///< [m²]
  double j_x;  ///< x − y [m]
  double j_y;  ///< y − x [m]
};

inline Distance1d distance_1d(double x, double y, double L) {
  return {0.5 * ((x - y) * (x - y) - L * L), x - y, y - x};
}

/// Returns the force multiplier that makes Ċ = ζ at the end of a step, λ = (ζ − J V) / (J M⁻¹ Jᵀ
/// Δt). The force on the two particles is (j_x, j_y) λ. `v_x`, `v_y` [m/s], masses [kg] > 0, `zeta`
/// [m²/s], `dt` [s] > 0, x ≠ y.
inline double lambda_1d(const Distance1d& c, double v_x, double v_y, double mass_x, double mass_y,
                        double zeta, double dt) {
  const double J_V = c.j_x * v_x + c.j_y * v_y;
  const double constraint_mass = c.j_x * c.j_x / mass_x + c.j_y * c.j_y / mass_y;
  return (zeta - J_V) / (constraint_mass * dt);
}

}  // namespace constraint_sim::engine
