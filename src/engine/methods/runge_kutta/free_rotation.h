#pragma once

#include <Eigen/Core>

#include "constraint_sim/engine/body.h"
#include "engine/dynamics/integrator_options.h"
#include "engine/math/integrate.h"
#include "engine/model/mass_properties.h"

namespace constraint_sim::engine {

/// Rotation of a body without joints. L is constant or grows with a constant torque; only q̇ = ½
/// (0, I_W⁻¹ L) ⊗ q is integrated, and for isotropic bodies not even q̇.
class FreeRotation {
 public:
  /// Whether spin or torque rotates the body.
  static bool turns(const Eigen::Vector3d& torque, const BodyState& state) {
    return !(state.angular_velocity.isZero(0.0) && torque.isZero(0.0));
  }
  IntegrationResult advance(double h, const Eigen::Vector3d& torque, const MassProperties& mass,
                            const IntegratorOptions& options, StopFlag stop, BodyState* state);
  /// Whether there is memory of the last interval.
  bool has_memory() const { return step_ != 0.0; }
  /// Visits the memory of the last interval, except the body, as engine/support/memory.h describes.
  template <class Self, class Visit>
  static void visit_memory(Self& self, Visit& visit) {
    visit(self.step_);
    visit(self.after_.angular_velocity);
    visit(self.after_.orientation.coeffs());
    visit(self.momentum_);
    visit(self.torque_);
    visit(self.first_derivative_);
  }

 private:
  double step_ = 0.0;                                   // first guess of the next substep [s]
  BodyState after_;                                     // state at the end of the last interval
  Eigen::Vector3d momentum_ = Eigen::Vector3d::Zero();  // L at the end of the last interval
  Eigen::Vector3d torque_ = Eigen::Vector3d::Zero();    // torque in the last interval
  // Derivative at the start of the next interval, where that continues.
  Eigen::Vector4d first_derivative_ = Eigen::Vector4d::Zero();
};

/// Advances x and v of a body without joints along its parabola.
void integrate_ballistic(double h, const Eigen::Vector3d& acceleration, BodyState* state);

}  // namespace constraint_sim::engine
