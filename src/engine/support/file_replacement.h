#pragma once

#include <string>

namespace constraint_sim::engine {

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

}  // namespace constraint_sim::engine
