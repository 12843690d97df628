#pragma once

/// Elementary functions that give the same bits on every machine: fixed sequences of + - * / and
/// square roots, which IEEE 754 rounds in one way. Functions of the C library differ from version
/// to version, and by the processor. `scripts/check_arithmetic` forbids them in the engine; each
/// error bound below is tested against MPFR (`bench/accuracy/elementary.cpp`).
namespace constraint_sim::engine::math {

struct SineCosine {
  double sine = 0.0;
  double cosine = 1.0;
};

/// Returns the sine of x [rad] of any size; error below 0.8 ulp. NaN for infinities.
double sin(double x);

/// Returns the cosine of x [rad] of any size; error below 0.8 ulp. NaN for infinities.
double cos(double x);

/// Returns sin(x) and cos(x) with the bits of both functions, for one reduction of x [rad].
SineCosine sin_cos(double x);

/// Returns the angle of the point (x, y) in [−π, π] [rad], with zeros and infinities as in C; error
/// below 1 ulp where the angle is a normal number.
double atan2(double y, double x);

/// Returns √(x² + y²) without intermediate overflow or underflow; error below 1.25 ulp.
double hypot(double x, double y);

/// Returns √(x² + y² + z²) without intermediate overflow or underflow; error below 1.6 ulp.
double hypot(double x, double y, double z);

/// Returns ⁵√x of a positive x; error below 1 ulp. Zero and infinity are their own roots.
double fifth_root(double x);

}  // namespace constraint_sim::engine::math
