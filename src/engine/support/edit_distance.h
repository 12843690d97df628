#pragma once

#include <algorithm>
#include <cstddef>
#include <string>

#include "engine/math/list.h"

namespace constraint_sim::engine {

/// Returns the number of letters to add, remove or change to turn one word into the other.
inline std::size_t edit_distance(const std::string& a, const std::string& b) {
  List<std::size_t> row(b.size() + 1);
  for (std::size_t j = 0; j <= b.size(); ++j) row[j] = j;
  for (std::size_t i = 1; i <= a.size(); ++i) {
    std::size_t diagonal = row[0];
    row[0] = i;
    for (std::size_t j = 1; j <= b.size(); ++j) {
      const std::size_t changed = diagonal + (a[i - 1] == b[j - 1] ? 0 : 1);
      diagonal = row[j];
      row[j] = std::min({changed, row[j] + 1, row[j - 1] + 1});
    }
  }
  return row[b.size()];
}

}  // namespace constraint_sim::engine
