#pragma once

#include <cmath>

#include "constraint_sim/engine/joint.h"
#include "engine/math/elementary.h"
#include "engine/math/numbers.h"
#include "engine/model/joint_data.h"

namespace constraint_sim::engine {

/// A prescribed length or share with its derivatives.
struct Prescribed {
  double value = 0.0;         ///< [m]
  double rate = 0.0;          ///< [m/s]
  double acceleration = 0.0;  ///< [m/s²]
};

/// Rate ζ(t) = bias + amplitude·sin(2π·frequency·t + phase) that a motor prescribes; see Motor.
struct MotorRate {
  double bias = 0.0, amplitude = 0.0;   ///< [m/s or rad/s]
  double frequency = 0.0, phase = 0.0;  ///< [Hz], [rad]

  bool is_moving() const { return bias != 0.0 || amplitude != 0.0; }
};
inline MotorRate motor_rate(const Motor& motor) {
  return {motor.bias, motor.amplitude, motor.frequency, motor.phase};
}
/// Returns ζ from time t on, without the bias where a timeout ended it at `expires_at`.
inline MotorRate motor_rate(const Motor& motor, double expires_at, double t) {
  MotorRate rate = motor_rate(motor);
  if (motor.timeout > 0.0 && expires_at <= t) rate.bias = 0.0;
  return rate;
}

/// Returns the angular frequency ω of ζ [rad/s].
inline double motor_omega(const MotorRate& motor) { return 2.0 * kPi * motor.frequency; }

/// Returns ∫ζ dt from t to t + h [m].
inline double motor_travel(const MotorRate& motor, double t, double h) {
  double travel = motor.bias * h;
  if (motor.amplitude == 0.0) return travel;
  // ∫ sin(ωt + φ) dt = h sin(ω(t + h/2) + φ) sin(x)/x with x = ωh/2
  const double omega = motor_omega(motor);
  const double x = 0.5 * omega * h;
  // Below 1e-4 the series to second order is exact up to rounding.
  const double sinc = std::abs(x) > 1e-4 ? math::sin(x) / x : 1.0 - x * x / 6.0;
  travel += motor.amplitude * h * math::sin(omega * (t + 0.5 * h) + motor.phase) * sinc;
  return travel;
}

/// Returns sine and cosine of the phase of ζ at time t; the default where ζ is constant.
inline math::SineCosine motor_phase(const MotorRate& motor, double t) {
  if (motor.amplitude == 0.0) return {};
  return math::sin_cos(motor_omega(motor) * t + motor.phase);
}

/// Returns ∫ζ dt over `h` seconds from a time of the given phase, with ζ and its rate at the end.
inline Prescribed motor_motion(const MotorRate& motor, const math::SineCosine& phase, double h) {
  if (motor.amplitude == 0.0) return {motor.bias * h, motor.bias, 0.0};
  // With x = ωh/2 the phase advances by x to the middle and by 2x to the end.
  const double omega = motor_omega(motor);
  const double x = 0.5 * omega * h;
  // √(1 − s²) is cheaper than a cosine, and as exact where s² is far below 1.
  const double s = math::sin(x);
  const double c = std::abs(x) <= 0.5 ? std::sqrt(1.0 - s * s) : math::cos(x);
  const double sinc = x == 0.0 ? 1.0 : s / x;
  const double middle = phase.sine * c + phase.cosine * s;
  const double sine = 2.0 * s * c, cosine = 1.0 - 2.0 * s * s;
  return {motor.bias * h + motor.amplitude * h * sinc * middle,
          motor.bias + motor.amplitude * (phase.sine * cosine + phase.cosine * sine),
          motor.amplitude * omega * (phase.cosine * cosine - phase.sine * sine)};
}

/// Returns the share of an error that is left `since` seconds after an edit: 1 − 10u³ + 15u⁴ − 6u⁵
/// with u = since/closing_time. Velocity and acceleration are zero at both ends.
Prescribed closing_motion(double since, double closing_time);

/// Returns the error `since` seconds after the start of a motion: the polynomial of degree 5 that
/// starts with offset, rate and acceleration, and has none of these at the end of its duration.
Prescribed moving_error(const MovingStart& start, double since);

/// Returns the longest duration up to `longest` in which the error does not change its sign, but at
/// least `shortest` [s]. A longer motion would go beyond the position and return.
double duration_without_overshoot(const MovingStart& start, double shortest, double longest);

}  // namespace constraint_sim::engine
