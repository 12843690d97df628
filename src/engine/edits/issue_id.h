#pragma once

#include <cstdint>
#include <limits>

#include "engine/model/validate.h"

namespace constraint_sim::engine {

/// An id that no body and no joint gets.
inline constexpr std::uint32_t kLastId = std::numeric_limits<std::uint32_t>::max();

/// Returns the next id and advances it; throws std::invalid_argument once all ids are issued.
template <class Id>
Id issue(Id* next) {
  if (next->value == kLastId) refuse("name", "gets no id: all of them are used");
  return {next->value++};
}

}  // namespace constraint_sim::engine
