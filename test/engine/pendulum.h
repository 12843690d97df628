#pragma once

#include <cmath>

#include "support.h"

namespace constraint_sim::engine {

// ---- a pendulum in closed form, by Jacobi's elliptic functions
//
// Released at an angle a from straight down, sin(φ/2) = k sn(K − ω t, k), with k = sin(a/2), K =
// K(k) and ω² = g/L: Abramowitz & Stegun, chapters 16 and 17.

/// Returns sn(u, k) by the arithmetic-geometric mean.
inline long double elliptic_sine(long double u, long double k) {
  constexpr int kMeans = 7;
  long double a[kMeans + 1] = {1}, c[kMeans + 1] = {k}, b = std::sqrt(1 - k * k);
  for (int i = 0; i < kMeans; ++i) {
    a[i + 1] = (a[i] + b) / 2;
    c[i + 1] = (a[i] - b) / 2;
    b = std::sqrt(a[i] * b);
  }
  long double phase = std::ldexp(a[kMeans] * u, kMeans);
  for (int i = kMeans; i > 0; --i) phase = (phase + std::asin(c[i] / a[i] * std::sin(phase))) / 2;
  return std::sin(phase);
}

/// Returns the first time at `to` of a pendulum released at `from` [s].
inline double time_of_fall(double from, double to, double length) {
  const long double k = std::sin(static_cast<long double>(from) / 2);
  const long double sine = std::sin(static_cast<long double>(to) / 2) / k;
  return static_cast<double>((std::comp_ellint_1(k) - std::ellint_1(k, std::asin(sine))) *
                             std::sqrt(static_cast<long double>(length / kGravity)));
}

/// Returns the angle at t of a pendulum released at `from` that rebounds from straight down, each
/// time with e of its speed and hence of its k.
inline double thrown_back(double from, double e, double length, double t) {
  long double k = std::sin(static_cast<long double>(from) / 2), quarter = std::comp_ellint_1(k);
  long double u = quarter + std::sqrt(static_cast<long double>(kGravity / length)) * t;
  while (u > 2 * quarter) {
    u -= 2 * quarter;
    k *= e;
    quarter = std::comp_ellint_1(k);
  }
  return static_cast<double>(2 * std::asin(k * elliptic_sine(u, k)));
}

}  // namespace constraint_sim::engine
