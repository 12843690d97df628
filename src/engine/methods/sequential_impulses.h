#pragma once

#include <Eigen/Core>
#include <vector>

#include "constraint_sim/body.h"
#include "constraint_sim/row.h"
#include "constraint_sim/stop_flag.h"
#include "engine/mass_properties.h"

namespace constraint_sim::engine {

/// Stages 4 to 6 of the tutorial's step: gravity, then one row after the other at velocity level
/// until the sweeps are used up, then positions with the final velocities. First order in h.
/// `moved` are the bodies to carry, by index. Holds only scratch memory, kept from step to step.
class SequentialImpulses {
 public:
  using Bodies = std::vector<BodyState>;
  using Masses = std::vector<MassProperties>;

  /// 4. v += h g, and what the rows' first guesses do.
  void update_velocities(const std::vector<int>& moved, Bodies& bodies, const Masses& masses,
                         const Eigen::Vector3d& gravity, double h, const std::vector<Row>& rows);

  /// 5. Sweeps over the rows; leaves the impulses in them. Ends early once `stop` is set.
  void solve(Bodies& bodies, std::vector<Row>& rows, int iterations, StopFlag stop = nullptr) const;

  /// 6. x += h v, q by the rotation h ω; keeps the angular momentum of every free body.
  static void update_positions(const std::vector<int>& moved, Bodies& bodies, const Masses& masses,
                               double h);

 private:
  /// Of one row: M⁻¹ Jᵀ and 1/(J M⁻¹ Jᵀ + softness).
  struct Response {
    Eigen::Vector3d v_A, w_A, v_B, w_B;
    double inverse_mass;
  };

  void respond(const std::vector<int>& moved, const std::vector<Row>& rows, const Bodies& bodies,
               const Masses& masses);
  void push(std::size_t i, double impulse, const std::vector<Row>& rows, Bodies& bodies) const;

  std::vector<Eigen::Matrix3d> inverse_inertia_W_;
  std::vector<Response> responses_;
};

}  // namespace constraint_sim::engine
