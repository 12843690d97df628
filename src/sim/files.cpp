#include "sim/files.h"

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

#include "sim/words.h"

namespace constraint_sim {
namespace {

constexpr std::size_t kShownPath = 200;  // characters

[[noreturn]] void refuse(const std::string& what, const std::string& path, const std::string& why) {
  const std::string shown = path.c_str();  // up to a zero byte, which what() ends at as well
  throw std::invalid_argument("path: cannot " + what + " '" + shortened(shown, kShownPath) +
                              "': " + why);
}

[[noreturn]] void refuse(const std::string& what, const std::string& path, int error) {
  refuse(what, path, std::string(std::strerror(error)));
}

/// An open file or folder.
class Descriptor {
 public:
  explicit Descriptor(int number) : number_(number) {}
  Descriptor(const Descriptor&) = delete;
  Descriptor& operator=(const Descriptor&) = delete;
  ~Descriptor() {
    if (number_ >= 0) ::close(number_);
  }
  operator int() const { return number_; }

 private:
  int number_;
};

void check_regular(const std::string& what, const std::string& path, const struct stat& status) {
  if (S_ISDIR(status.st_mode)) refuse(what, path, EISDIR);
  if (!S_ISREG(status.st_mode)) refuse(what, path, "it is not a regular file");
}

void check_size(const std::string& path, std::size_t size, std::size_t most) {
  if (size > most) refuse("read", path, "it is larger than " + std::to_string(most >> 20) + " MiB");
}

std::string real_path(const std::string& what, const std::string& path) {
  char* const found = ::realpath(path.c_str(), nullptr);
  if (found == nullptr) refuse(what, path, errno);
  std::string real = found;
  std::free(found);  // NOLINT: as realpath wants it
  return real;
}

/// A path without links of a file that may not be there yet.
std::string resolved(const std::string& path) {
  if (path.find('\0') != std::string::npos) refuse("use", path, "it has a zero byte");
  struct stat status {};
  if (::lstat(path.c_str(), &status) == 0) return real_path("resolve", path);
  if (errno != ENOENT) refuse("use", path, errno);
  const std::size_t slash = path.rfind('/');
  const std::string name = slash == std::string::npos ? path : path.substr(slash + 1);
  if (name.empty()) refuse("use", path, ENOENT);
  const std::string folder = slash == std::string::npos ? "." : path.substr(0, slash + 1);
  return real_path("use", folder) + "/" + name;
}

void write_all(int file, const std::string& path, const std::string& text) {
  for (std::size_t done = 0; done < text.size();) {
    const ssize_t written = ::write(file, text.data() + done, text.size() - done);
    if (written < 0 && errno == EINTR) continue;
    if (written < 0) refuse("write", path, errno);
    done += static_cast<std::size_t>(written);
  }
}

/// A file of a name that nobody else has, removed unless it becomes another.
class Unfinished {
 public:
  Unfinished(int folder, const std::string& name, const std::string& path) : folder_(folder) {
    static std::atomic<unsigned> count{0};
    do {
      name_ = "." + name.substr(0, NAME_MAX / 2) + "." + std::to_string(::getpid()) + "." +
              std::to_string(++count) + ".unfinished";
      file_ = ::openat(folder, name_.c_str(), O_WRONLY | O_CREAT | O_EXCL | O_NOFOLLOW | O_CLOEXEC,
                       0666);
    } while (file_ < 0 && errno == EEXIST);
    if (file_ < 0) refuse("write", path, errno);
  }
  Unfinished(const Unfinished&) = delete;
  Unfinished& operator=(const Unfinished&) = delete;
  ~Unfinished() {
    ::close(file_);
    if (!name_.empty()) ::unlinkat(folder_, name_.c_str(), 0);
  }

  int file() const { return file_; }
  bool become(const std::string& name) {
    if (::renameat(folder_, name_.c_str(), folder_, name.c_str()) != 0) return false;
    name_.clear();
    return true;
  }

 private:
  int folder_;
  int file_ = -1;
  std::string name_;
};

}  // namespace

std::string read_file(const std::string& path, std::size_t most,
                      const std::function<void(const std::string& start)>& check) {
  if (path.find('\0') != std::string::npos) refuse("read", path, "it has a zero byte");
  // before it is opened, which some devices take for an order
  struct stat status {};
  if (::stat(path.c_str(), &status) != 0) refuse("read", path, errno);
  check_regular("read", path, status);
  const Descriptor file(::open(path.c_str(), O_RDONLY | O_NONBLOCK | O_NOCTTY | O_CLOEXEC));
  if (file < 0 || ::fstat(file, &status) != 0) refuse("read", path, errno);
  check_regular("read", path, status);
  check_size(path, static_cast<std::size_t>(status.st_size), most);
  std::string text;
  bool is_checked = check == nullptr;
  char piece[1 << 16];
  for (;;) {
    const ssize_t count = ::read(file, piece, sizeof piece);
    if (count < 0 && errno == EINTR) continue;
    if (count < 0) refuse("read", path, errno);
    if (count == 0) return text;
    text.append(piece, static_cast<std::size_t>(count));
    check_size(path, text.size(), most);  // some grow, and those of the kernel have no size
    if (is_checked) continue;
    check(text);
    is_checked = true;
    text.reserve(static_cast<std::size_t>(status.st_size));
  }
}

void write_file(const std::string& path, const std::string& text) {
  const std::string target = resolved(path);
  const std::size_t slash = target.rfind('/');
  const std::string folder_path = target.substr(0, slash + 1), name = target.substr(slash + 1);
  const Descriptor folder(::open(folder_path.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC));
  if (folder < 0) refuse("write", path, errno);
  struct stat before {};
  const bool exists = ::fstatat(folder, name.c_str(), &before, AT_SYMLINK_NOFOLLOW) == 0;
  if (!exists && errno != ENOENT) refuse("write", path, errno);
  if (exists) check_regular("write", path, before);

  Unfinished unfinished(folder, name, path);
  write_all(unfinished.file(), path, text);
  if (exists && ::fchmod(unfinished.file(), before.st_mode & 07777) != 0)
    refuse("write", path, errno);
  if (::fsync(unfinished.file()) != 0) refuse("write", path, errno);
  if (!unfinished.become(name)) refuse("write", path, errno);
  // some file systems cannot, and then the name may be lost with the power, but not the old text
  ::fsync(folder);
}

std::string path_below(const std::string& folder, const std::string& path) {
  const std::string top = real_path("use", folder);
  std::string target = resolved(path.empty() || path[0] != '/' ? top + "/" + path : path);
  const std::string inside = top == "/" ? top : top + "/";
  const std::string name = target.substr(target.rfind('/') + 1);
  if (target.compare(0, inside.size(), inside) != 0 || name == ".." || name == ".")
    refuse("use", path, "it is not below scene_folder '" + shortened(folder, kShownPath) + "'");
  return target;
}

}  // namespace constraint_sim
