#include "engine/constraints/course.h"

#include <cmath>

namespace constraint_sim::engine {
namespace {

constexpr double kPi = 3.14159265358979323846;

}  // namespace

double motor_travel(const Motor& motor, double t, double h) {
  double travel = motor.bias * h;
  if (motor.amplitude == 0.0) return travel;
  // ∫ sin(ωt + φ) dt = h sin(ω(t + h/2) + φ) sin(x)/x with x = ωh/2
  const double omega = 2.0 * kPi * motor.frequency;
  const double x = 0.5 * omega * h;
  const double sinc = std::abs(x) > 1e-4 ? std::sin(x) / x : 1.0 - x * x / 6.0;
  travel += motor.amplitude * h * std::sin(omega * (t + 0.5 * h) + motor.phase) * sinc;
  return travel;
}

Course motor_course(const Motor& motor, double t, double h) {
  const double omega = 2.0 * kPi * motor.frequency;
  const double phase = omega * (t + h) + motor.phase;
  return {motor_travel(motor, t, h), motor.bias + motor.amplitude * std::sin(phase),
          motor.amplitude * omega * std::cos(phase)};
}

Course closing_course(double since, double closing_time) {
  const double u = since / closing_time;
  if (u >= 1.0) return {};
  return {1.0 - u * u * u * (10.0 - u * (15.0 - 6.0 * u)),
          -30.0 * u * u * (1.0 - u) * (1.0 - u) / closing_time,
          -60.0 * u * (1.0 - u) * (1.0 - 2.0 * u) / (closing_time * closing_time)};
}

}  // namespace constraint_sim::engine
