#include "engine/support/file_replacement.h"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <atomic>
#include <cerrno>
#include <climits>
#include <cstdio>

#include "engine/support/paths.h"

namespace constraint_sim::engine {

FileReplacement::FileReplacement(const std::string& path) : path_(path) {
  const std::string target = resolved_path(path);
  const std::size_t slash = target.rfind('/');
  const std::string folder = target.substr(0, slash + 1);
  name_ = target.substr(slash + 1);
  folder_ = ::open(folder.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC);
  if (folder_ < 0) refuse_path("write", path, errno);
  try {
    create();
  } catch (...) {
    discard();
    throw;
  }
}

void FileReplacement::create() {
  struct stat before {};
  const bool exists = ::fstatat(folder_, name_.c_str(), &before, AT_SYMLINK_NOFOLLOW) == 0;
  if (!exists && errno != ENOENT) refuse_path("write", path_, errno);
  if (exists) check_regular_file("write", path_, before);
  static std::atomic<unsigned> count{0};
  do {
    unfinished_ = "." + name_.substr(0, NAME_MAX / 2) + "." + std::to_string(::getpid()) + "." +
                  std::to_string(++count) + ".unfinished";
    file_ = ::openat(folder_, unfinished_.c_str(),
                     O_WRONLY | O_CREAT | O_EXCL | O_NOFOLLOW | O_CLOEXEC, 0666);
  } while (file_ < 0 && errno == EEXIST);
  if (file_ < 0) refuse_path("write", path_, errno);
  if (exists && ::fchmod(file_, before.st_mode & 07777) != 0) refuse_path("write", path_, errno);
}

FileReplacement::~FileReplacement() { discard(); }

void FileReplacement::discard() {
  if (file_ >= 0) {
    ::close(file_);
    ::unlinkat(folder_, unfinished_.c_str(), 0);
  }
  if (folder_ >= 0) ::close(folder_);
  file_ = folder_ = -1;
}

void FileReplacement::write(const std::string& text) {
  for (std::size_t done = 0; done < text.size();) {
    const ssize_t written = ::write(file_, text.data() + done, text.size() - done);
    if (written < 0 && errno == EINTR) continue;
    if (written < 0) refuse_path("write", path_, errno);
    done += static_cast<std::size_t>(written);
  }
}

void FileReplacement::commit() {
  if (::fsync(file_) != 0) refuse_path("write", path_, errno);
  if (::renameat(folder_, unfinished_.c_str(), folder_, name_.c_str()) != 0)
    refuse_path("write", path_, errno);
  ::close(file_);
  file_ = -1;
  // Some file systems cannot sync a folder: a power failure may lose the new name, but not the old
  // text.
  ::fsync(folder_);
}

}  // namespace constraint_sim::engine
