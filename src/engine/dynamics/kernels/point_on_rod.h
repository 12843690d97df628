#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>

#include "engine/dynamics/kernel_view.h"
#include "engine/math/numbers.h"

namespace constraint_sim::engine {

/// Kernel for one body on one rod to a fixed or prescribed point (is_point_on_rod()), the most
/// common scene. The size of the state is a compile-time constant. With u = λ/m, and d from the
/// point to the body:
///   v̇ = a + u d,  u = (C̈_target − ‖ḋ‖² − d·(a − a_point)) / d²
/// Valid for one interval: points into the equations.
class PointOnRod {
 public:
  explicit PointOnRod(EquationsOfMotion& equations)
      : PointOnRod(equations, equations.kernel_view()) {}

  static constexpr std::size_t size() { return 8; }  // x and v, each padded to an even length

  void derivative(std::size_t stage, double t, const double* y, double* dydt) {
    if (equations_.inputs().is_time_dependent()) move_with_time(t);
    const Vector3d d = d_of(y);
    const Vector3d v = ConstVector(y + kVelocityAt);
    accelerate(stage, d, d.squaredNorm(), v, dydt);
  }

  /// Projects by Newton steps, each along d of the previous iterate.
  bool project(double t, double* y) {
    if (equations_.inputs().is_time_dependent()) move_with_time(t);
    const double length = length_;
    Vector3d d = d_of(y);
    double before = kInfinity;
    const auto error_of = [=](const Vector3d& of) {
      return 0.5 * (length * length - of.squaredNorm()) / length;
    };
    double error = error_of(d);
    const double rounding = kEpsilon * std::max(scale_, std::abs(error));
    while (!(std::abs(error) <= rounding)) {
      if (!(std::abs(error) <= 0.5 * before)) return before <= 16.0 * rounding;
      before = std::abs(error);
      const Vector3d step = error * length / d.squaredNorm() * d;
      for (Eigen::Index i = 0; i < 3; ++i) y[i] += step[i];
      d = d_of(y);
      error = error_of(d);
    }
    return true;
  }

  template <class Pair>
  void accept(double h) {
    equations_.accept<Pair>(h);
  }

  bool restart(double* y, double* dydt) {
    const Vector3d d = d_of(y);
    const double d2 = d.squaredNorm();
    Vector v(y + kVelocityAt);
    const Vector3d d_dot = v - velocity_;
    const double u = (rate_target_ - d.dot(d_dot)) / d2;
    v += u * d;
    impulse_ += mass_ * u * length_;
    accelerate(0, d, d2, v, dydt);
    return true;
  }

  double rounding() const { return equations_.rounding(); }

  double squared_size_of(const double* dy, double h, bool is_of_rates = false) const {
    const double x2 = is_of_rates ? 0.0 : ConstVector(dy).squaredNorm();
    const double v2 = h * h * ConstVector(dy + kVelocityAt).squaredNorm();
    return v2 <= x2 ? x2 : v2;  // NaN: x has none unless v has
  }

 private:
  PointOnRod(EquationsOfMotion& equations, const KernelView& view)
      : equations_(equations),
        point_(std::max(equations.links().front().a, equations.links().front().b)),
        mass_(1.0 / equations.inverse_mass(0)),
        scale_(view.scale),
        length_(view.lengths->value),
        rate_target_(*view.rate_target),
        acceleration_target_(*view.acceleration_target),
        position_(view.position[point_]),
        velocity_(view.velocity[point_]),
        free_(*view.applied_acceleration),
        free_point_(view.applied_acceleration[point_]),
        free_apart_(free_ - free_point_),
        impulse_(*view.impulses),
        stage_forces_(view.stage_forces) {}

  using Vector3d = Eigen::Vector3d;
  using ConstVector = Eigen::Map<const Vector3d>;
  using Vector = Eigen::Map<Vector3d>;
  static constexpr Eigen::Index kVelocityAt = 4;  // offset of v in a state

  void move_with_time(double t) {
    equations_.move_with_time(t);
    free_apart_ = free_ - free_point_;
  }

  Vector3d d_of(const double* y) const { return ConstVector(y) - position_; }

  void accelerate(std::size_t stage, const Vector3d& d, double d2, const Vector3d& v,
                  double* dydt) {
    const Vector3d& a = free_;
    const Vector3d d_dot = v - velocity_;
    const double u = (acceleration_target_ - d_dot.squaredNorm() - d.dot(free_apart_)) / d2;
    const Vector3d v_dot = a + u * d;
    for (Eigen::Index i = 0; i < 3; ++i) {
      dydt[i] = v[i];
      dydt[kVelocityAt + i] = v_dot[i];
    }
    dydt[3] = dydt[kVelocityAt + 3] = 0.0;
    stage_forces_[stage] = mass_ * u * length_;
  }

  EquationsOfMotion& equations_;
  std::size_t point_;
  double mass_, scale_;
  // References, since time changes the values.
  const double &length_, &rate_target_, &acceleration_target_;
  const Vector3d &position_, &velocity_;  // motion of the point
  const Vector3d &free_, &free_point_;    // free accelerations of body and point
  Vector3d free_apart_;                   // free acceleration of the body minus that of the point
  double& impulse_;
  double* stage_forces_;
};

}  // namespace constraint_sim::engine
