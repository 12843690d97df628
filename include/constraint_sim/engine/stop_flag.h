#pragma once

#include <atomic>

namespace constraint_sim::engine {

/// A flag that another thread sets to end a long step early; nullptr: none.
using StopFlag = const std::atomic<bool>*;

inline bool is_set(StopFlag stop) {
  return stop != nullptr && stop->load(std::memory_order_relaxed);
}

}  // namespace constraint_sim::engine
