#pragma once

#include <sys/stat.h>

#include <string>

namespace constraint_sim::engine {

// Paths named by users and by callers of services.

/// Throws std::invalid_argument: "path: cannot WHAT 'PATH': WHY". The path is shortened.
[[noreturn]] void refuse_path(const std::string& what, const std::string& path,
                              const std::string& why);
/// As above, with the message of an error number of the system.
[[noreturn]] void refuse_path(const std::string& what, const std::string& path, int error);

/// Throws std::invalid_argument, as refuse_path(), for anything but a regular file.
void check_regular_file(const std::string& what, const std::string& path,
                        const struct stat& status);

/// Returns the path without links of a file or folder that exists. Throws as refuse_path().
std::string real_path_of(const std::string& what, const std::string& path);
/// Returns a path without links of a file that need not exist. Throws as refuse_path().
std::string resolved_path(const std::string& path);

/// Returns the file that `path` leads to, with links resolved; it must lie below `folder`, where
/// relative paths start. The file need not exist.
std::string path_below(const std::string& folder, const std::string& path);

}  // namespace constraint_sim::engine
