#pragma once

#include <string>

#include "constraint_sim/engine/options.h"
#include "engine/model/validate.h"

namespace constraint_sim::engine {

// Checks of options and fields. Each throws std::invalid_argument("NAME: must be ..., got VALUE")
// for a value out of range.
inline void check(const std::string& name, double value, AnyValue) { check_finite(name, value); }
inline void check(const std::string& name, const Eigen::Vector3d& value, AnyValue) {
  check_finite(name, value);
}
inline void check(const std::string&, Method, AnyValue) {}
inline void check(const std::string&, bool, AnyValue) {}
void check(const std::string& name, double value, Positive range);
void check(const std::string& name, const Eigen::Vector3d& value, Positive range);
void check(const std::string& name, double value, PositiveOrInfinity);
inline void check(const std::string& name, double value, NotNegative) {
  check_not_negative(name, value);
}
inline void check(const std::string& name, double value, Share) { check_share(name, value); }
void check(const std::string& name, int value, Count range);
void check(const std::string& name, int value, EitherOf range);

// Ranges in the words of docs/scenes.md; empty where the type has no limits.
inline std::string words(const Eigen::Vector3d&, AnyValue) { return "[3]"; }
std::string words(Method, AnyValue);
inline std::string words(bool, AnyValue) { return ""; }
std::string words(double, Positive range);
inline std::string words(double, PositiveOrInfinity) { return "> 0 or .inf"; }
inline std::string words(double, NotNegative) { return "≥ 0"; }
inline std::string words(double, Share) { return "0 to 1"; }
std::string words(int, Count range);
std::string words(int, EitherOf range);

/// Returns range and meaning of an option: `8 or 5; of runge_kutta: order of the pair`.
template <class Value, class Range>
std::string range_and_meaning(const OptionInfo& info, const Value& value, Range range) {
  std::string text = words(value, range);
  if (!text.empty()) text += "; ";
  if (info.read_by != Method::kAuto) text += "of " + std::string(name(info.read_by)) + ": ";
  return text + info.meaning;
}

}  // namespace constraint_sim::engine
