#pragma once

#include <optional>
#include <tuple>

#include "constraint_sim/engine/joint.h"

namespace constraint_sim::engine {

// Exact equality of settings, number by number.

inline auto numbers_of(const Motor& m) {
  return std::tie(m.bias, m.amplitude, m.frequency, m.phase, m.max_force, m.timeout);
}

inline bool are_same(const Motor& a, const Motor& b) { return numbers_of(a) == numbers_of(b); }

inline bool are_same(const std::optional<CoordinateMotor>& a,
                     const std::optional<CoordinateMotor>& b) {
  if (!a || !b) return a.has_value() == b.has_value();
  const auto further = [](const CoordinateMotor& m) {
    return std::tie(m.position, m.servo_frequency, m.servo_damping_ratio, m.servo_stiffness,
                    m.servo_damping, m.force);
  };
  return numbers_of(*a) == numbers_of(*b) && further(*a) == further(*b);
}

inline bool are_same(const CoordinateLaw& a, const CoordinateLaw& b) {
  const auto numbers = [](const CoordinateLaw& law) {
    return std::tie(law.lower, law.upper, law.limit_restitution, law.friction, law.damping,
                    law.stiffness, law.rest, law.frequency, law.damping_ratio, law.position,
                    law.zero);
  };
  return numbers(a) == numbers(b) && are_same(a.motor, b.motor);
}

}  // namespace constraint_sim::engine
