#pragma once

#include <array>
#include <cstddef>
#include <optional>

namespace constraint_sim::engine {

// First root of a polynomial. The polynomial lies in the hull of its Bernstein coefficients, so no
// root is missed: Farouki, Computer Aided Geometric Design 29 (2012) 379, section 5.

/// A polynomial on [0, 1] by its Bernstein coefficients.
template <std::size_t kCoefficients>
using Bernstein = std::array<double, kCoefficients>;

/// Returns the first root in [0, 1] after which the polynomial is negative.
template <std::size_t n>
std::optional<double> first_root(Bernstein<n> p, double from = 0.0, double to = 1.0,
                                 int halvings = 50) {
  bool is_above = true;
  for (const double c : p) is_above = is_above && c >= 0.0;
  if (is_above) return std::nullopt;
  if (p[0] < 0.0 || halvings == 0) return from;
  Bernstein<n> right;  // de Casteljau's subdivision in the middle
  for (std::size_t k = 0; k < n; ++k) {
    right[n - 1 - k] = p[n - 1];
    for (std::size_t i = n - 1; i > k; --i) p[i] = 0.5 * (p[i - 1] + p[i]);
  }
  const double middle = 0.5 * (from + to);
  if (const auto root = first_root(p, from, middle, halvings - 1)) return root;
  return first_root(right, middle, to, halvings - 1);
}

/// Returns the first root after 0 of a polynomial with p(0) = 0.
template <std::size_t n>
std::optional<double> first_root_after_zero(const Bernstein<n>& p) {
  Bernstein<n - 1> quotient;  // coefficients of p(θ)/θ
  for (std::size_t i = 0; i + 1 < n; ++i)
    quotient[i] = p[i + 1] * static_cast<double>(n - 1) / static_cast<double>(i + 1);
  return first_root(quotient);
}

}  // namespace constraint_sim::engine
