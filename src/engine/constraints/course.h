#pragma once

#include "constraint_sim/engine/joint.h"

namespace constraint_sim::engine {

/// A length over time and how it changes.
struct Course {
  double value = 0.0;         ///< [m]
  double rate = 0.0;          ///< [m/s]
  double acceleration = 0.0;  ///< [m/s²]
};

/// ∫ζ dt from t to t + h [m].
double motor_travel(const Motor& motor, double t, double h);

/// The same, with ζ and its rate at the end.
Course motor_course(const Motor& motor, double t, double h);

/// Share of an error left by an edit that is still there `since` seconds later: 1 at first, 0 after
/// the closing time, with no velocity and no acceleration at either end: 1 − 10u³ + 15u⁴ − 6u⁵.
Course closing_course(double since, double closing_time);

}  // namespace constraint_sim::engine
