#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <cmath>
#include <string>

#include "engine/math/numbers.h"

namespace constraint_sim::engine {

// Checks of public input. Each throws std::invalid_argument("FIELD: must be ..., got VALUE").

[[noreturn]] void refuse(const std::string& field, const std::string& why);

/// The fewest digits that read back to the same double.
std::string shortest(double value);

/// The first 40 characters of a text that came from outside, what cannot be printed as `?`.
std::string excerpt(const std::string& text);
/// The same in single quotes.
std::string in_quotes(const std::string& text);

/// `(x, y, z)`.
std::string shown(const Eigen::Vector3d& v);

// No number is beyond kMostMagnitude, and none that is divided by below its inverse.
void check_finite(const std::string& field, double value);
void check_finite(const std::string& field, const Eigen::Vector3d& value);
void check_positive(const std::string& field, double value);
void check_between(const std::string& field, double value, double least, double most);
void check_not_negative(const std::string& field, double value);
void check_share(const std::string& field, double value);  ///< in [0, 1]
/// Finite, and not 0.
void check_axis(const std::string& field, const Eigen::Vector3d& value);

/// Whether two times near this one that are a tick apart differ as numbers [s].
bool is_rounding_within(double time, double time_step);
/// Whether a time [s] has a next one a tick later, and that one as well.
inline bool has_next_tick(double time, double time_step) {
  // never less than the next number is away
  return std::abs(time) * kEpsilon <= time_step || is_rounding_within(time, time_step);
}
void check_next_tick(const std::string& field, double time, double time_step);

/// Normalizes a quaternion; one that is of length 1 to round-off stays as it is, so that saving and
/// loading keeps it.
void make_unit(Eigen::Quaterniond* q);

/// `[A-Za-z0-9_][A-Za-z0-9_./-]*`, at most 255 characters, and not `world`.
void check_name(const std::string& field, const std::string& name);

}  // namespace constraint_sim::engine
