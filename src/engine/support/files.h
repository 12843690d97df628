#pragma once

#include <cstddef>
#include <functional>
#include <string>

namespace constraint_sim::engine {

// Files named by users and by callers of services. Failures throw std::invalid_argument with the
// path.

/// Largest size of a scene, equal to kMostSceneBytes.
inline constexpr std::size_t kMostBytes = std::size_t{6} << 20;

/// Returns the bytes of a regular file of up to `most`; follows a link. `check` is called with the
/// first bytes before the rest is read, and may throw.
std::string read_file(const std::string& path, std::size_t most = kMostBytes,
                      const std::function<void(const std::string& start)>& check = nullptr);

/// Creates or replaces a regular file as a whole: on return the text is on the disk, on failure the
/// old file stays. Follows a link. Keeps the mode of an existing file.
void write_file(const std::string& path, const std::string& text);

}  // namespace constraint_sim::engine
