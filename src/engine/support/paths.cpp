#include "engine/support/paths.h"

#include <cerrno>
#include <cstddef>
#include <cstdlib>
#include <cstring>
#include <stdexcept>

#include "engine/support/shortened.h"

namespace constraint_sim::engine {
namespace {

constexpr std::size_t kShownPath = 200;  // most characters of a path in a message

}  // namespace

void refuse_path(const std::string& what, const std::string& path, const std::string& why) {
  const std::string shown = path.c_str();  // ends at a zero byte, like what()
  throw std::invalid_argument("path: cannot " + what + " '" + shortened(shown, kShownPath) +
                              "': " + why);
}

void refuse_path(const std::string& what, const std::string& path, int error) {
  refuse_path(what, path, std::string(std::strerror(error)));
}

void check_regular_file(const std::string& what, const std::string& path,
                        const struct stat& status) {
  if (S_ISDIR(status.st_mode)) refuse_path(what, path, EISDIR);
  if (!S_ISREG(status.st_mode)) refuse_path(what, path, "it is not a regular file");
}

std::string real_path_of(const std::string& what, const std::string& path) {
  char* const found = ::realpath(path.c_str(), nullptr);
  if (found == nullptr) refuse_path(what, path, errno);
  std::string real = found;
  std::free(found);  // NOLINT: realpath allocates by malloc
  return real;
}

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
