#pragma once

#include <cstddef>

namespace constraint_sim::engine {

/// Calls of operator new since the program began.
std::size_t counted_allocations();

}  // namespace constraint_sim::engine
