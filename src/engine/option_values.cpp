#include "engine/option_values.h"

#include <cmath>

#include "engine/validate.h"

namespace constraint_sim::engine {

void check(const char* name, const Eigen::Vector3d& value, AnyValue) { check_finite(name, value); }

void check(const char* name, double value, Positive range) {
  check_positive(name, value);
  check_between(name, value, range.least, range.most);
}

void check(const char* name, double value, PositiveOrInfinity) {
  if (!(value > 0.0)) refuse(name, "must be above 0, or .inf, got " + shortest(value));
}

void check(const char* name, double value, NotNegative) { check_not_negative(name, value); }

void check(const char* name, double value, Share) { check_share(name, value); }

void check(const char* name, int value, Count range) {
  if (value < 1) refuse(name, "must be >= 1, got " + std::to_string(value));
  if (value > range.most)
    refuse(name,
           "must be at most " + std::to_string(range.most) + ", got " + std::to_string(value));
}

void check(const char* name, int value, EitherOf range) {
  if (value != range.first && value != range.second)
    refuse(name, "must be " + words(value, range) + ", got " + std::to_string(value));
}

std::string words(Method, AnyValue) {
  std::string text = name(Method{});
  for (std::size_t i = 1; i < kMethodCount; ++i)
    text += (i + 1 < kMethodCount ? ", " : " or ") + std::string(name(static_cast<Method>(i)));
  return text;
}

std::string words(double, Positive range) {
  if (std::isinf(range.most)) return "> 0";
  const auto exponent = [](double value) {  // as people write powers of ten
    return "1e" + std::to_string(std::lround(std::log10(value)));
  };
  return exponent(range.least) + " to " + exponent(range.most);
}

std::string words(int, Count range) { return "whole, 1 to " + std::to_string(range.most); }

std::string words(int, EitherOf range) {
  return std::to_string(range.first) + " or " + std::to_string(range.second);
}

void validate(const WorldOptions& options) {
  visit_options(options, [](const OptionInfo& info, const auto& value, auto range) {
    check(info.name, value, range);
  });
}

}  // namespace constraint_sim::engine
