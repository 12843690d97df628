#pragma once

#include <cstddef>

namespace constraint_sim::engine {

/// Returns the calls of operator new since the program started.
std::size_t counted_allocations();

}  // namespace constraint_sim::engine
