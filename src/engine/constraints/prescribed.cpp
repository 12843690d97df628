#include "engine/constraints/prescribed.h"

#include <algorithm>

namespace constraint_sim::engine {
namespace {

constexpr int kHalvings = 50;  // bisections of an interval of durations

// Factor p of the error e(u) = (1 − u)³ p(u), with p(u) = A + B u + C u².
struct MovingFactor {
  double A, B, C;

  MovingFactor(const MovingStart& start, double duration)
      : A(start.offset),
        B(3.0 * start.offset + duration * start.rate),
        C(6.0 * start.offset +
          duration * (3.0 * start.rate + 0.5 * duration * start.acceleration)) {}

  // Whether p has the sign of A, or is 0, for u from 0 to 1.
  bool keeps_sign() const {
    const double side = A < 0.0 ? -1.0 : 1.0;
    const double a = side * A, b = side * B, c = side * C;
    if (a + b + c < 0.0) return false;
    const bool has_least = c > 0.0 && b < 0.0 && -b < 2.0 * c;  // between 0 and 1
    return !has_least || 4.0 * a * c >= b * b;
  }
};

}  // namespace

Prescribed moving_error(const MovingStart& start, double since) {
  const double u = since / start.duration;
  if (u >= 1.0) return {};
  const MovingFactor p(start, start.duration);
  const double w = 1.0 - u;
  const double value = p.A + u * (p.B + u * p.C), slope = p.B + 2.0 * u * p.C;
  return {
      w * w * w * value, w * w * (w * slope - 3.0 * value) / start.duration,
      w * (w * (2.0 * w * p.C - 6.0 * slope) + 6.0 * value) / (start.duration * start.duration)};
}

double duration_without_overshoot(const MovingStart& start, double shortest, double longest) {
  const bool approaches = start.offset * start.rate < 0.0;
  if (!approaches || MovingFactor(start, longest).keeps_sign()) return longest;
  double fits = shortest, exceeds = longest;
  for (int i = 0; i < kHalvings; ++i) {
    const double middle = 0.5 * (fits + exceeds);
    (MovingFactor(start, middle).keeps_sign() ? fits : exceeds) = middle;
  }
  return fits;
}

Prescribed closing_motion(double since, double closing_time) {
  const double u = since / closing_time;
  if (u >= 1.0) return {};
  return {1.0 - u * u * u * (10.0 - u * (15.0 - 6.0 * u)),
          -30.0 * u * u * (1.0 - u) * (1.0 - u) / closing_time,
          -60.0 * u * (1.0 - u) * (1.0 - 2.0 * u) / (closing_time * closing_time)};
}

}  // namespace constraint_sim::engine
