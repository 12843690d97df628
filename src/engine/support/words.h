#pragma once

#include <algorithm>
#include <initializer_list>
#include <ios>
#include <locale>
#include <optional>
#include <sstream>
#include <string>

namespace constraint_sim::engine {

// Plain scalars of YAML, in scenes and in options that are given as text.

inline bool is_one_of(const std::string& word, std::initializer_list<const char*> words) {
  return std::find(words.begin(), words.end(), word) != words.end();
}

/// Returns the number that is all of `text`, in the classic locale.
template <class Number>
std::optional<Number> number_in(const std::string& text) {
  std::istringstream stream(text);
  stream.imbue(std::locale::classic());
  stream.unsetf(std::ios::dec);
  Number value{};
  if (!(stream >> std::noskipws >> value) || !(stream >> std::ws).eof()) return std::nullopt;
  return value;
}

inline std::optional<bool> flag_in(const std::string& text) {
  if (is_one_of(text, {"true", "True", "TRUE", "yes", "Yes", "YES", "on", "On", "ON", "y", "Y"}))
    return true;
  if (is_one_of(text, {"false", "False", "FALSE", "no", "No", "NO", "off", "Off", "OFF", "n", "N"}))
    return false;
  return std::nullopt;
}

}  // namespace constraint_sim::engine
