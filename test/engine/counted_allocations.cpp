#include "counted_allocations.h"

#include <atomic>
#include <cstdlib>
#include <new>

namespace {

std::atomic<std::size_t> count{0};  // threads allocate too
std::atomic<std::ptrdiff_t> left_to_failure{-1};

void* allocate(std::size_t size) noexcept {
  count.fetch_add(1, std::memory_order_relaxed);
  if (left_to_failure.load(std::memory_order_relaxed) >= 0 && left_to_failure.fetch_sub(1) == 0)
    return nullptr;
  return std::malloc(size == 0 ? 1 : size);
}

}  // namespace

namespace constraint_sim::engine {

std::size_t counted_allocations() { return count; }

std::ptrdiff_t let_fail_after(std::ptrdiff_t left) { return left_to_failure.exchange(left); }

}  // namespace constraint_sim::engine

// Replaces operator new and delete of the whole program, in their own file, or compilers report
// mismatched pairs. The engine has no aligned allocations.
void* operator new(std::size_t size) {
  if (void* memory = allocate(size)) return memory;
  throw std::bad_alloc();
}
void* operator new[](std::size_t size) { return operator new(size); }
void* operator new(std::size_t size, const std::nothrow_t&) noexcept { return allocate(size); }
void operator delete(void* memory) noexcept { std::free(memory); }
void operator delete[](void* memory) noexcept { std::free(memory); }
void operator delete(void* memory, std::size_t) noexcept { std::free(memory); }
void operator delete[](void* memory, std::size_t) noexcept { std::free(memory); }
