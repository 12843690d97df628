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

/// Creates or replaces a regular file as a whole. Until commit() the text is in a file beside it,
/// `.NAME.PID.COUNT.unfinished`, which the destructor removes. Follows a link. Keeps the mode of an
/// existing file.
class FileReplacement {
 public:
  /// Throws std::invalid_argument where the folder is not writable, or `path` exists and is no
  /// regular file.
  explicit FileReplacement(const std::string& path);
  FileReplacement(const FileReplacement&) = delete;
  FileReplacement& operator=(const FileReplacement&) = delete;
  ~FileReplacement();

  /// Appends text. Throws std::invalid_argument with the message of the system.
  void write(const std::string& text);
  /// Gives the file its name; on return the whole text is on the disk. Throws std::invalid_argument
  /// like write().
  void commit();

 private:
  void create();
  void discard();

  std::string path_, name_, unfinished_;
  int folder_ = -1, file_ = -1;  // file_ is open until commit()
};

/// Creates or replaces a regular file as a whole: on return the text is on the disk, on failure the
/// old file stays. Follows a link. Keeps the mode of an existing file.
void write_file(const std::string& path, const std::string& text);

/// Returns the file that `path` leads to, with links resolved; it must lie below `folder`, where
/// relative paths start. The file need not exist.
std::string path_below(const std::string& folder, const std::string& path);

}  // namespace constraint_sim::engine
