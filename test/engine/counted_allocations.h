#pragma once

#include <cstddef>

namespace constraint_sim::engine {

/// Returns the calls of operator new since the program started.
std::size_t counted_allocations();

/// Lets an allocation fail after `left` more of them; < 0: none fails. Returns the number left.
std::ptrdiff_t let_fail_after(std::ptrdiff_t left);

}  // namespace constraint_sim::engine
