#pragma once

#include <algorithm>
#include <cstddef>
#include <string>
#include <vector>

#include "engine/support/edit_distance.h"
#include "engine/support/shortened.h"

namespace constraint_sim {

using engine::shortened;

/// Returns a message with the text between the first quote after `from` and the last quote
/// shortened.
inline std::string with_short_quotes(const std::string& message, std::size_t from = 0) {
  const std::size_t first = message.find('\'', from), last = message.rfind('\'');
  if (first == std::string::npos || first == last) return message;
  const std::string quoted = message.substr(first + 1, last - first - 1);
  return message.substr(0, first + 1) + shortened(quoted) + message.substr(last);
}

/// Returns the known word closest to `word`; empty if none is close.
inline std::string closest(const std::string& word, const std::vector<std::string>& known) {
  constexpr std::size_t kLongestWord = 100;
  if (word.size() > kLongestWord) return "";
  std::size_t least = std::max<std::size_t>(1, word.size() / 3) + 1;
  std::string found;
  for (const std::string& candidate : known) {
    const std::size_t distance = engine::edit_distance(word, candidate);
    if (distance >= least) continue;
    least = distance;
    found = candidate;
  }
  return found;
}

/// Returns `; did you mean 'pendulum'?`, or nothing where no known word is close.
inline std::string did_you_mean(const std::string& word, const std::vector<std::string>& known) {
  const std::string found = closest(word, known);
  return found.empty() ? "" : "; did you mean '" + found + "'?";
}

}  // namespace constraint_sim
