#pragma once

#include <cstddef>
#include <functional>
#include <string>

namespace constraint_sim::engine {

// Files that users and callers of services name. What cannot be throws std::invalid_argument with
// the path.

inline constexpr std::size_t kMostBytes = std::size_t{6} << 20;  ///< of a scene, as load_scene

/// The bytes of a regular file of up to `most`; a link is followed. `check` is called with its
/// first bytes before the others are read, and may throw.
std::string read_file(const std::string& path, std::size_t most = kMostBytes,
                      const std::function<void(const std::string& start)>& check = nullptr);

/// A regular file that is made, or takes the place of another, as a whole: until commit() there is
/// only a file beside it, named `.NAME.PID.COUNT.unfinished`, which the destructor removes. Of a
/// link the file that it leads to. The mode of a file that was there stays.
class FileReplacement {
 public:
  /// Throws std::invalid_argument where the folder cannot be written to, and for anything at `path`
  /// that is no regular file.
  explicit FileReplacement(const std::string& path);
  FileReplacement(const FileReplacement&) = delete;
  FileReplacement& operator=(const FileReplacement&) = delete;
  ~FileReplacement();

  /// Appends. Throws std::invalid_argument with what the system says.
  void write(const std::string& text);
  /// Gives the file its name: the whole text is on the disk when this returns. Throws as write().
  void commit();

 private:
  void create();
  void discard();

  std::string path_, name_, unfinished_;
  int folder_ = -1, file_ = -1;  // file_ is open until commit()
};

/// Replaces or makes a regular file: the whole text, on the disk when this returns, or the file as
/// it was. Of a link the file that it leads to. The mode of a file that was there stays.
void write_file(const std::string& path, const std::string& text);

/// The file that `path` leads to, links resolved, which must lie below `folder`; a relative path
/// starts there. The file itself need not exist.
std::string path_below(const std::string& folder, const std::string& path);

}  // namespace constraint_sim::engine
