#pragma once

#include <cstddef>
#include <string>

namespace constraint_sim::engine {

/// Returns at most `most` characters of a text, with dots where it is cut.
inline std::string shortened(const std::string& text, std::size_t most = 40) {
  if (text.size() <= most) return text;
  std::size_t end = most;
  while (end > 0 && (static_cast<unsigned char>(text[end]) & 0xC0U) == 0x80U) --end;  // UTF-8
  return text.substr(0, end) + "...";
}

}  // namespace constraint_sim::engine
