#include "engine/support/files.h"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>

#include "engine/support/file_replacement.h"
#include "engine/support/paths.h"

namespace constraint_sim::engine {
namespace {

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

void check_file_size(const std::string& path, std::size_t size, std::size_t most) {
  if (size > most)
    refuse_path("read", path, "it is larger than " + std::to_string(most >> 20) + " MiB");
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

void write_file(const std::string& path, const std::string& text) {
  FileReplacement file(path);
  file.write(text);
  file.commit();
}

}  // namespace constraint_sim::engine
