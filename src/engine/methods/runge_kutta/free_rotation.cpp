#include "engine/methods/runge_kutta/free_rotation.h"

#include <array>

#include "engine/math/numbers.h"
#include "engine/math/quaternion_state.h"
#include "engine/methods/runge_kutta/integrate_by_order.h"

namespace constraint_sim::engine {
namespace {

using Eigen::Vector3d;

/// The quaternion (x, y, z, w) of a body with known angular momentum, as a System of integrate.h.
class Turning {
 public:
  Turning(const MassProperties& mass, const Vector3d& momentum, const Vector3d& torque)
      : inverse_inertia_(mass.inverse_inertia),
        momentum_(momentum),
        torque_(torque),
        radius_(mass.radius_of_gyration()) {}

  static constexpr std::size_t size() { return 4; }

  void derivative(std::size_t, double t, const double* y, double* dydt) const {
    const Vector3d L = momentum_ + t * torque_;
    // ω_B = I_B⁻¹ Rᵀ L, and q̇ = ½ q ⊗ (0, ω_B). Within stages q is not exactly of unit length.
    const double w = y[3];
    const Vector3d v(y[0], y[1], y[2]);
    const Vector3d c = L.cross(v);
    const Vector3d L_B = L + 2.0 / (w * w + v.squaredNorm()) * (w * c + c.cross(v));
    const Vector3d s = 0.5 * inverse_inertia_.cwiseProduct(L_B);
    Eigen::Map<Vector3d> rate(dydt);
    rate = w * s + v.cross(s);
    dydt[3] = -v.dot(s);
  }
  bool project(double t, double* y) {
    end_ = t;
    return normalize_quaternions(y, 1);
  }
  template <class Pair>
  void accept(double) {}
  bool restart(const double* y, double* dydt) const {
    derivative(0, end_, y, dydt);
    return true;
  }
  double rounding() const { return 4.0 * kEpsilon * radius_; }
  double squared_size_of(const double* dy, double) const {
    return 4.0 * radius_ * radius_ * Eigen::Map<const Eigen::Vector4d>(dy).squaredNorm();
  }

 private:
  Vector3d inverse_inertia_, momentum_, torque_;
  double radius_;
  double end_ = 0.0;
};

}  // namespace

IntegrationResult FreeRotation::advance(double h, const Vector3d& torque,
                                        const MassProperties& mass,
                                        const IntegratorOptions& options, StopFlag stop,
                                        BodyState* state) {
  const bool is_driven = !torque.isZero(0.0);
  if (!is_driven && mass.is_isotropic()) {
    state->orientation = (rotation(h * state->angular_velocity) * state->orientation).normalized();
    return {};
  }
  const bool goes_on = state->angular_velocity == after_.angular_velocity &&
                       state->orientation.coeffs() == after_.orientation.coeffs();
  const Vector3d momentum =  // continued to the last bit
      goes_on ? momentum_
              : apply_inertia(mass.inertia, state->orientation, state->angular_velocity);
  Turning turning(mass, momentum, torque);
  std::array<double, StageMemory::kRows * Turning::size()> numbers;
  const StageMemory memory(numbers.data(), Turning::size());
  Eigen::Map<Eigen::Vector4d> q(memory.state());
  q = state->orientation.coeffs();
  Eigen::Map<Eigen::Vector4d> first_derivative(memory.derivatives());
  if (goes_on && torque == torque_)
    first_derivative = first_derivative_;
  else
    turning.derivative(0, 0.0, memory.state(), memory.derivatives());
  const IntegrationResult progress = integrate(turning, memory, 0.0, h, options, stop, step_);
  if (!progress.done) return progress;
  state->orientation.coeffs() = q;
  momentum_ = momentum + h * torque;
  state->angular_velocity = apply_inertia(mass.inverse_inertia, state->orientation, momentum_);
  after_ = *state;
  torque_ = torque;
  first_derivative_ = first_derivative;
  return progress;
}

void integrate_ballistic(double h, const Vector3d& acceleration, BodyState* state) {
  state->position += h * (state->linear_velocity + 0.5 * h * acceleration);
  state->linear_velocity += h * acceleration;
}

}  // namespace constraint_sim::engine
