#pragma once

#include <Eigen/Core>
#include <array>

#include "engine/constraints/rows.h"

namespace constraint_sim::engine {

// Free coordinates of a joint as functions of its vectors. A translation z_A·d is a product like a
// row; an angle is φ = atan2(s, c) with c and s weighted sums of products; a length is ‖d‖.

/// Angle φ by which the joint's frame on B is twisted about an axis. With c = ½(x_A·x_B + y_A·y_B)
/// and s = ½(y_A·x_B − x_A·y_B) the twist about z_A is regular up to a swing of half a turn.
struct AngleForm {
  struct Term {
    RowForm form;
    double weight = 0.0;
  };
  std::array<Term, 2> c, s;
  bool is_twist = false;  ///< whether c and s are those of the twist about z_A
};

/// The length ‖d‖.
struct LengthForm {};

/// A scalar function of the vectors of a joint: a row of its kind, or a free coordinate.
struct ScalarForm {
  bool is_angle = false;
  bool is_length = false;
  RowForm product;          ///< product u·v; ½ d·d for a length; not used for an angle
  bool is_product = false;  ///< whether the value is `product`
  AngleForm angle;

  constexpr ScalarForm() : ScalarForm(RowForm{}) {}
  // NOLINTNEXTLINE(google-explicit-constructor): each row is a scalar form
  constexpr ScalarForm(RowForm form) : product(form), is_product(!form.is_custom()) {}
  constexpr explicit ScalarForm(AngleForm form) : is_angle(true), angle(form) {}
  constexpr explicit ScalarForm(LengthForm /*form*/) : is_length(true) {}

  /// Whether the value is in metres.
  constexpr bool has_separation() const { return !is_angle && product.has_separation(); }
};

/// Numbers c and s of an AngleForm, or their Jacobians.
template <class Number>
struct CosineAndSine {
  Number c{}, s{};
};

CosineAndSine<double> values(const AngleForm& form, const JointVectors& vectors);
CosineAndSine<Jacobian> jacobians(const AngleForm& form, const JointVectors& vectors);

/// Returns u·v, ‖d‖, or φ in (−π, π].
double value(const ScalarForm& form, const JointVectors& vectors);

/// Returns the Jacobian by (v_A, ω_A, v_B, ω_B): (c ∇s − s ∇c)/(c² + s²) for an angle, ∇(½ d·d)/‖d‖
/// for a length.
Jacobian jacobian(const ScalarForm& form, const JointVectors& vectors);

double rate(const ScalarForm& form, const JointVectors& vectors, const JointMotion& motion);

/// Value of a scalar function, and its rate.
struct ValueAndRate {
  double value = 0.0, rate = 0.0;
};

/// Returns value() and rate(), which share the numbers c and s of an angle.
ValueAndRate value_and_rate(const ScalarForm& form, const JointVectors& vectors,
                            const JointMotion& motion);

/// Returns γ = q̈ − J V̇.
double gamma(const ScalarForm& form, const JointVectors& vectors, const JointMotion& motion);

/// Returns `angle` plus the whole turns that bring it nearest to `reference` [rad].
double unwound(double angle, double reference);

/// Returns a coordinate that was at `position` h [s] ago: the integral of its rate by the
/// trapezoidal rule. Angles are unwrapped to the turn nearest to the integral.
inline double integrated(double position, double h, double rate_before, double rate_now) {
  return h == 0.0 ? position : position + 0.5 * h * (rate_before + rate_now);
}

/// Returns the weighted sum of two Jacobians.
Jacobian combined(double weight_a, const Jacobian& a, double weight_b, const Jacobian& b);

/// Returns the discrete gradient G of a step, with G·step = q₁ − q₀.
Jacobian discrete_gradient(const ScalarForm& form, const JointVectors& start,
                           const JointVectors& end);

/// Change of an angle over a step from (c₀, s₀) to (c₁, s₁), less than half a turn, with a factor
/// κ. κ (c̄ ∇̄s − s̄ ∇̄c), of means and discrete gradients, is the discrete gradient of the angle:
/// κ = k(Δφ)/P with k(x) = x/sin x, P = ‖(c₀, s₀)‖‖(c₁, s₁)‖.
struct AngleStep {
  double change = 0.0;  ///< Δφ [rad]
  double kappa = 0.0;
  double kappa_c = 0.0;                   ///< ∂κ/∂c₁
  double kappa_s = 0.0;                   ///< ∂κ/∂s₁
  double change_c = 0.0, change_s = 0.0;  ///< ∂Δφ/∂c₁, ∂Δφ/∂s₁

  AngleStep(CosineAndSine<double> start, CosineAndSine<double> end);
};

}  // namespace constraint_sim::engine
