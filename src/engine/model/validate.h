#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <cmath>
#include <string>

#include "engine/math/numbers.h"

namespace constraint_sim::engine {

// Checks of public input. Each throws std::invalid_argument("FIELD: must be ..., got VALUE").

[[noreturn]] void refuse(const std::string& field, const std::string& why);

/// Returns the fewest digits that read back as the same double.
std::string shortest(double value);

/// Returns the first 40 characters of an external text, with `?` for unprintable ones.
std::string excerpt(const std::string& text);
/// Returns excerpt() in single quotes.
std::string in_quotes(const std::string& text);

/// Returns `(x, y, z)`.
std::string shown(const Eigen::Vector3d& v);

// Numbers are at most kMostMagnitude, and divisors at least its inverse.
void check_finite(const std::string& field, double value);
void check_finite(const std::string& field, const Eigen::Vector3d& value);
/// Requires at most kMostSaved: saved states follow from bounded numbers, such as the difference of
/// two positions or the acceleration of an anchor, and may be beyond the bound themselves.
void check_saved(const std::string& field, double value);
void check_saved(const std::string& field, const Eigen::Vector3d& value);
void check_positive(const std::string& field, double value);
void check_between(const std::string& field, double value, double least, double most);
void check_not_negative(const std::string& field, double value);
void check_share(const std::string& field, double value);  ///< in [0, 1]
/// Requires finite numbers, not all 0.
void check_axis(const std::string& field, const Eigen::Vector3d& value);

/// Whether times near this one that are a tick apart differ as doubles [s].
bool is_rounding_within(double time, double time_step);
/// Whether a time [s] differs from the next tick, and the next tick from the one after it.
inline bool has_next_tick(double time, double time_step) {
  // The next double is never farther away than |time| times kEpsilon.
  return std::abs(time) * kEpsilon <= time_step || is_rounding_within(time, time_step);
}
void check_next_tick(const std::string& field, double time, double time_step);

/// Normalizes a quaternion. One of length 1 up to rounding stays unchanged, so that saving and
/// loading keeps it.
void make_unit(Eigen::Quaterniond* q);

/// Requires `[A-Za-z0-9_][A-Za-z0-9_./-]*`, at most 255 characters, and not `world`.
void check_name(const std::string& field, const std::string& name);

}  // namespace constraint_sim::engine
