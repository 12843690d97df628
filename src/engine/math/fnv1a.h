#pragma once

#include <cstddef>
#include <cstdint>

namespace constraint_sim::engine {

/// Hash of no bytes.
inline constexpr std::uint64_t kEmptyFnv1a = 0xcbf29ce484222325ULL;

/// Returns a hash extended by some bytes: 64-bit FNV-1a (Fowler, Noll & Vo).
inline std::uint64_t fnv1a(const void* data, std::size_t size, std::uint64_t hash = kEmptyFnv1a) {
  const auto* bytes = static_cast<const unsigned char*>(data);
  for (std::size_t i = 0; i < size; ++i) hash = (hash ^ bytes[i]) * 0x100000001b3ULL;
  return hash;
}

}  // namespace constraint_sim::engine
