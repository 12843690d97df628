#include "engine/model/option_values.h"

#include <cmath>
#include <optional>
#include <sstream>
#include <type_traits>

#include "engine/math/numbers.h"
#include "engine/model/method_names.h"
#include "engine/model/validate.h"
#include "engine/support/words.h"

namespace constraint_sim::engine {

void check(const std::string& name, double value, Positive range) {
  check_positive(name, value);
  check_between(name, value, range.least, range.most);
}

void check(const std::string& name, const Eigen::Vector3d& value, Positive range) {
  for (int i = 0; i < 3; ++i) check(name + "." + "xyz"[i], value[i], range);
}

void check(const std::string& name, double value, PositiveOrInfinity) {
  if (!(value > 0.0)) refuse(name, "must be above 0, or .inf, got " + shortest(value));
}

void check(const std::string& name, int value, Count range) {
  if (value < 1) refuse(name, "must be >= 1, got " + std::to_string(value));
  if (value > range.most)
    refuse(name,
           "must be at most " + std::to_string(range.most) + ", got " + std::to_string(value));
}

void check(const std::string& name, int value, EitherOf range) {
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
  const auto exponent = [](double value) {  // powers of ten in short form
    int power = 0;
    for (; value > 3.0; value /= 10.0) ++power;
    for (; value < 0.3; value *= 10.0) --power;
    return "1e" + std::to_string(power);
  };
  return exponent(range.least) + " to " + exponent(range.most);
}

std::string words(int, Count range) { return "whole, 1 to " + std::to_string(range.most); }

std::string words(int, EitherOf range) {
  return std::to_string(range.first) + " or " + std::to_string(range.second);
}

namespace {

std::string trimmed_text(const std::string& text) {
  const std::size_t first = text.find_first_not_of(" \t");
  if (first == std::string::npos) return "";
  return text.substr(first, text.find_last_not_of(" \t") + 1 - first);
}

[[noreturn]] void refuse_option_text(const char* name, const char* expected,
                                     const std::string& text) {
  refuse(name, std::string("must be ") + expected + ", got " + in_quotes(text));
}

template <class Number>
Number option_number(const char* name, const char* expected, const std::string& text) {
  const std::optional<Number> number = number_in<Number>(text);
  if (!number) refuse_option_text(name, expected, text);
  return *number;
}

template <class Range>
void read_option_text(const char* name, const std::string& text, double* value, Range) {
  const bool is_infinity = std::is_same_v<Range, PositiveOrInfinity> && text == ".inf";
  *value = is_infinity ? kInfinity : option_number<double>(name, "a number", text);
}

template <class Range>
void read_option_text(const char* name, const std::string& text, int* value, Range) {
  *value = option_number<int>(name, "a whole number", text);
}

void read_option_text(const char* name, const std::string& text, bool* value, AnyValue) {
  const std::optional<bool> flag = flag_in(text);
  if (!flag) refuse_option_text(name, "true or false", text);
  *value = *flag;
}

void read_option_text(const char* /*name*/, const std::string& text, Method* value, AnyValue) {
  *value = method_named(text);
}

void read_option_text(const char* name, const std::string& text, Eigen::Vector3d* value, AnyValue) {
  constexpr const char* kExpected = "a list of 3 numbers";
  if (text.size() < 2 || text.front() != '[' || text.back() != ']')
    refuse_option_text(name, kExpected, text);
  std::istringstream list(text.substr(1, text.size() - 2));
  std::string number;
  int count = 0;
  for (; std::getline(list, number, ','); ++count) {
    if (count == 3) refuse_option_text(name, kExpected, text);
    (*value)[count] = option_number<double>(name, kExpected, trimmed_text(number));
  }
  if (count != 3) refuse_option_text(name, kExpected, text);
}

}  // namespace

void set_option(const std::string& name, const std::string& text, WorldOptions* options) {
  bool is_known = false;
  visit_options(*options, [&](const OptionInfo& info, auto& value, auto range) {
    if (name != info.name) return;
    is_known = true;
    read_option_text(info.name, trimmed_text(text), &value, range);
  });
  if (!is_known) refuse("keys", "there is no option " + in_quotes(name));
}

void validate(const WorldOptions& options) {
  visit_options(options, [](const OptionInfo& info, const auto& value, auto range) {
    check(info.name, value, range);
  });
}

}  // namespace constraint_sim::engine
