#include "engine/support/files.h"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <atomic>
#include <cerrno>
#include <climits>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <stdexcept>

#include "engine/support/shortened.h"

namespace constraint_sim::engine {
namespace {

constexpr std::size_t kShownPath = 200;  // most characters of a path in a message

[[noreturn]] void refuse_path(const std::string& what, const std::string& path,
                              const std::string& why) {
  const std::string shown = path.c_str();  // ends at a zero byte, like what()
  throw std::invalid_argument("path: cannot " + what + " '" + shortened(shown, kShownPath) +
                              "': " + why);
}

[[noreturn]] void refuse_path(const std::string& what, const std::string& path, int error) {
  refuse_path(what, path, std::string(std::strerror(error)));
}

/// Owner of an open file or folder.
class FileDescriptor {
 public:
  explicit FileDescriptor(int number) : number_(number) {}
  FileDescriptor(const FileDescriptor&) = delete;
  FileDescriptor& operator=(const FileDescriptor&) = delete;
  ~FileDescriptor() {
    if (number_ >= 0) ::close(number_);
  }
  operator int() const { return number_; }

 private:
  int number_;
};

void check_regular_file(const std::string& what, const std::string& path,
                        const struct stat& status) {
  if (S_ISDIR(status.st_mode)) refuse_path(what, path, EISDIR);
  if (!S_ISREG(status.st_mode)) refuse_path(what, path, "it is not a regular file");
}

void check_file_size(const std::string& path, std::size_t size, std::size_t most) {
  if (size > most)
    refuse_path("read", path, "it is larger than " + std::to_string(most >> 20) + " MiB");
}

std::string real_path_of(const std::string& what, const std::string& path) {
  char* const found = ::realpath(path.c_str(), nullptr);
  if (found == nullptr) refuse_path(what, path, errno);
  std::string real = found;
  std::free(found);  // NOLINT: realpath allocates by malloc
  return real;
}

/// Returns a path without links of a file that need not exist.
std::string resolved_path(const std::string& path) {
  if (path.find('\0') != std::string::npos) refuse_path("use", path, "it has a zero byte");
  struct stat status {};
  if (::lstat(path.c_str(), &status) == 0) return real_path_of("resolve", path);
  if (errno != ENOENT) refuse_path("use", path, errno);
  const std::size_t slash = path.rfind('/');
  const std::string name = slash == std::string::npos ? path : path.substr(slash + 1);
  if (name.empty()) refuse_path("use", path, ENOENT);
  const std::string folder = slash == std::string::npos ? "." : path.substr(0, slash + 1);
  return real_path_of("use", folder) + "/" + name;
}

}  // namespace

std::string read_file(const std::string& path, std::size_t most,
                      const std::function<void(const std::string& start)>& check) {
  if (path.find('\0') != std::string::npos) refuse_path("read", path, "it has a zero byte");
  // Checked before opening, since opening is a command to some devices.
  struct stat status {};
  if (::stat(path.c_str(), &status) != 0) refuse_path("read", path, errno);
  check_regular_file("read", path, status);
  const FileDescriptor file(::open(path.c_str(), O_RDONLY | O_NONBLOCK | O_NOCTTY | O_CLOEXEC));
  if (file < 0 || ::fstat(file, &status) != 0) refuse_path("read", path, errno);
  check_regular_file("read", path, status);
  check_file_size(path, static_cast<std::size_t>(status.st_size), most);
  std::string text;
  bool is_checked = check == nullptr;
  char piece[1 << 16];
  for (;;) {
    const ssize_t count = ::read(file, piece, sizeof piece);
    if (count < 0 && errno == EINTR) continue;
    if (count < 0) refuse_path("read", path, errno);
    if (count == 0) return text;
    text.append(piece, static_cast<std::size_t>(count));
    check_file_size(path, text.size(), most);  // files may grow, and kernel files report no size
    if (is_checked) continue;
    check(text);
    is_checked = true;
    text.reserve(static_cast<std::size_t>(status.st_size));
  }
}

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

void write_file(const std::string& path, const std::string& text) {
  FileReplacement file(path);
  file.write(text);
  file.commit();
}

std::string path_below(const std::string& folder, const std::string& path) {
  const std::string top = real_path_of("use", folder);
  std::string target = resolved_path(path.empty() || path[0] != '/' ? top + "/" + path : path);
  const std::string inside = top == "/" ? top : top + "/";
  const std::string name = target.substr(target.rfind('/') + 1);
  if (target.compare(0, inside.size(), inside) != 0 || name == ".." || name == ".")
    refuse_path("use", path,
                "it is not below scene_folder '" + shortened(folder, kShownPath) + "'");
  return target;
}

}  // namespace constraint_sim::engine
