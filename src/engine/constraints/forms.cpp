#include "engine/constraints/forms.h"

#include <cmath>

#include "engine/constraints/custom_code.h"
#include "engine/math/elementary.h"
#include "engine/math/numbers.h"

namespace constraint_sim::engine {
namespace {

// Function x/sin x and its derivative.
struct Stretch {
  double value, slope;

  explicit Stretch(double x) {
    const double square = x * x;
    // |x| below 1e-3: the next term is below rounding of the value and 4e-14 of the slope. The
    // closed form of the slope loses six digits or more there by cancellation.
    if (square < 1e-6) {
      value = 1.0 + square * (1.0 / 6.0 + square * 7.0 / 360.0);
      slope = x * (1.0 / 3.0 + square * 7.0 / 90.0);
      return;
    }
    const auto [sine, cosine] = math::sin_cos(x);
    value = x / sine;
    slope = (sine - x * cosine) / (sine * sine);
  }
};

template <class Evaluate>
auto sum(const std::array<AngleForm::Term, 2>& terms, Evaluate evaluate) {
  return evaluate(terms[0].form) * terms[0].weight + evaluate(terms[1].form) * terms[1].weight;
}

// Returns d/‖d‖; for coincident anchors the x axis of the world.
Eigen::Vector3d unit(const Eigen::Vector3d& d) {
  const double length = d.norm();
  return length > 0.0 ? Eigen::Vector3d(d / length) : Eigen::Vector3d::UnitX();
}

// Returns the Jacobian whose force on B is n.
Jacobian along(const JointVectors& vectors, const Eigen::Vector3d& n) {
  return {-n, -vectors.r_A.cross(n), n, vectors.r_B.cross(n)};
}

// Numbers c and s of an angle, and their rates.
struct AngleMotion {
  CosineAndSine<double> at, rates;

  double value() const { return math::atan2(at.s, at.c); }
  // Returns 0 where there is no angle, as of a universal joint with parallel z axes.
  double rate() const {
    const double square = at.c * at.c + at.s * at.s;
    return square == 0.0 ? 0.0 : (at.c * rates.s - at.s * rates.c) / square;
  }
};

// Returns the twist about z_A. Each rate of an axis serves two of its four products.
AngleMotion twist(const JointVectors& vectors, const JointMotion& motion) {
  using Eigen::Vector3d;
  const Vector3d x_A = vectors.axes_A.col(0), y_A = vectors.axes_A.col(1);
  const Vector3d x_B = vectors.axes_B.col(0), y_B = vectors.axes_B.col(1);
  const Vector3d w_B = motion.w_B + motion.spin;
  const Vector3d dx_A = motion.w_A.cross(x_A), dy_A = motion.w_A.cross(y_A);
  const Vector3d dx_B = w_B.cross(x_B), dy_B = w_B.cross(y_B);
  const double dxx = dx_A.dot(x_B) + x_A.dot(dx_B), dyy = dy_A.dot(y_B) + y_A.dot(dy_B);
  const double dyx = dy_A.dot(x_B) + y_A.dot(dx_B), dxy = dx_A.dot(y_B) + x_A.dot(dy_B);
  return {{0.5 * x_A.dot(x_B) + 0.5 * y_A.dot(y_B), 0.5 * y_A.dot(x_B) - 0.5 * x_A.dot(y_B)},
          {0.5 * dxx + 0.5 * dyy, 0.5 * dyx - 0.5 * dxy}};
}

AngleMotion motion_of(const AngleForm& form, const JointVectors& vectors,
                      const JointMotion& motion) {
  if (form.is_twist) return twist(vectors, motion);
  const auto evaluate = [&](RowForm row) { return product_rate(row, vectors, motion); };
  return {values(form, vectors), {sum(form.c, evaluate), sum(form.s, evaluate)}};
}

Jacobian sum_of_jacobians(const std::array<AngleForm::Term, 2>& terms,
                          const JointVectors& vectors) {
  return combined(terms[0].weight, product_jacobian(terms[0].form, vectors), terms[1].weight,
                  product_jacobian(terms[1].form, vectors));
}

}  // namespace

Jacobian combined(double weight_a, const Jacobian& a, double weight_b, const Jacobian& b) {
  Jacobian J;
  J.j1 = weight_a * a.j1 + weight_b * b.j1;
  J.j2 = weight_a * a.j2 + weight_b * b.j2;
  J.j3 = weight_a * a.j3 + weight_b * b.j3;
  J.j4 = weight_a * a.j4 + weight_b * b.j4;
  return J;
}

CosineAndSine<double> values(const AngleForm& form, const JointVectors& vectors) {
  const auto evaluate = [&](RowForm row) { return product_value(row, vectors); };
  return {sum(form.c, evaluate), sum(form.s, evaluate)};
}

CosineAndSine<Jacobian> jacobians(const AngleForm& form, const JointVectors& vectors) {
  return {sum_of_jacobians(form.c, vectors), sum_of_jacobians(form.s, vectors)};
}

double value(const ScalarForm& form, const JointVectors& vectors) {
  if (form.is_product) return product_value(form.product, vectors);
  if (form.is_length) return vectors.d.norm();
  if (!form.is_angle) return vectors.custom->value(vectors);
  const CosineAndSine<double> at = values(form.angle, vectors);
  return math::atan2(at.s, at.c);
}

Jacobian jacobian(const ScalarForm& form, const JointVectors& vectors) {
  if (form.is_product) return product_jacobian(form.product, vectors);
  if (form.is_length) return along(vectors, unit(vectors.d));
  if (!form.is_angle) return vectors.custom->jacobian(vectors);
  const CosineAndSine<double> at = values(form.angle, vectors);
  const CosineAndSine<Jacobian> J = jacobians(form.angle, vectors);
  const double square = at.c * at.c + at.s * at.s;
  return combined(at.c / square, J.s, -at.s / square, J.c);
}

double rate(const ScalarForm& form, const JointVectors& vectors, const JointMotion& motion) {
  if (form.is_product) return product_rate(form.product, vectors, motion);
  if (form.is_length) return unit(vectors.d).dot(motion.d_dot);
  if (!form.is_angle) return vectors.custom->rate(vectors, motion);
  return motion_of(form.angle, vectors, motion).rate();
}

ValueAndRate value_and_rate(const ScalarForm& form, const JointVectors& vectors,
                            const JointMotion& motion) {
  if (!form.is_angle) return {value(form, vectors), rate(form, vectors, motion)};
  const AngleMotion angle = motion_of(form.angle, vectors, motion);
  return {angle.value(), angle.rate()};
}

// γ of an angle: (c γ_s − s γ_c − 2 φ̇ (c ċ + s ṡ))/(c² + s²); of a length ℓ: (‖ḋ‖² + d·β_d −
// ℓ̇²)/ℓ.
double gamma(const ScalarForm& form, const JointVectors& vectors, const JointMotion& motion) {
  if (form.is_product) return product_gamma(form.product, vectors, motion);
  if (form.is_length) {
    const Eigen::Vector3d n = unit(vectors.d);
    const double across = (motion.d_dot - n.dot(motion.d_dot) * n).squaredNorm();
    const double length = vectors.d.norm();
    return n.dot(motion.d_bias) + (length > 0.0 ? across / length : 0.0);
  }
  if (!form.is_angle) return vectors.custom->gamma(vectors, motion);
  const CosineAndSine<double> at = values(form.angle, vectors);
  const auto rate_of = [&](RowForm row) { return product_rate(row, vectors, motion); };
  const auto gamma_of = [&](RowForm row) { return product_gamma(row, vectors, motion); };
  const double c_dot = sum(form.angle.c, rate_of), s_dot = sum(form.angle.s, rate_of);
  const double square = at.c * at.c + at.s * at.s;
  const double phi_dot = (at.c * s_dot - at.s * c_dot) / square;
  return (at.c * sum(form.angle.s, gamma_of) - at.s * sum(form.angle.c, gamma_of) -
          2.0 * phi_dot * (at.c * c_dot + at.s * s_dot)) /
         square;
}

Jacobian discrete_gradient(const ScalarForm& form, const JointVectors& start,
                           const JointVectors& end) {
  const JointVectors mean = between(start, end, 0.5);
  if (form.is_product) return product_jacobian(form.product, mean);
  if (form.is_length) {
    const double length = start.d.norm() + end.d.norm();
    return along(mean, length > 0.0 ? Eigen::Vector3d(2.0 / length * mean.d) : unit(mean.d));
  }
  if (!form.is_angle) return start.custom->discrete_gradient(start, end);
  const CosineAndSine<double> at_start = values(form.angle, start),
                              at_end = values(form.angle, end);
  const CosineAndSine<Jacobian> J = jacobians(form.angle, mean);
  const double half = 0.5 * AngleStep(at_start, at_end).kappa;
  return combined(half * (at_start.c + at_end.c), J.s, -half * (at_start.s + at_end.s), J.c);
}

double unwound(double angle, double reference) {
  return angle + 2.0 * kPi * std::round((reference - angle) / (2.0 * kPi));
}

// With σ = s₁c₀ − c₁s₀, χ = c₀c₁ + s₀s₁, P = √(σ² + χ²): Δφ = atan2(σ, χ), κ = k(Δφ)/P, k(x) =
// x/sin x.
AngleStep::AngleStep(CosineAndSine<double> start, CosineAndSine<double> end) {
  const double sigma = end.s * start.c - end.c * start.s;
  const double chi = start.c * end.c + start.s * end.s;
  const double square = sigma * sigma + chi * chi;
  const double P = std::sqrt(square);
  change = math::atan2(sigma, chi);
  const Stretch k(change);
  kappa = k.value / P;
  const auto slopes = [&](double d_sigma, double d_chi, double* of_change, double* of_kappa) {
    *of_change = (chi * d_sigma - sigma * d_chi) / square;
    const double of_P = (sigma * d_sigma + chi * d_chi) / P;
    *of_kappa = k.slope * *of_change / P - kappa * of_P / P;
  };
  slopes(-start.s, start.c, &change_c, &kappa_c);
  slopes(start.c, start.s, &change_s, &kappa_s);
}

}  // namespace constraint_sim::engine
