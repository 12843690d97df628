// Scenes in files: which files may be read, and which file a name stands for.

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <filesystem>
#include <system_error>

#include "constraint_sim/engine/scene.h"
#include "engine/model/validate.h"
#include "engine/support/edit_distance.h"

namespace constraint_sim::engine {
namespace {

namespace fs = std::filesystem;

/// Owner of an open file.
class Descriptor {
 public:
  explicit Descriptor(const std::string& path)
      // O_NONBLOCK, since opening or reading a pipe could wait forever.
      : value_(::open(path.c_str(), O_RDONLY | O_CLOEXEC | O_NONBLOCK | O_NOCTTY)) {}
  ~Descriptor() {
    if (value_ >= 0) ::close(value_);
  }
  Descriptor(const Descriptor&) = delete;
  Descriptor& operator=(const Descriptor&) = delete;

  int value() const { return value_; }

 private:
  int value_;
};

[[noreturn]] void fail(const std::string& path, const std::string& why) {
  throw SceneError(path + ": " + why);
}

std::string text_of_file(const std::string& path) {
  if (path.find('\0') != std::string::npos)
    fail(excerpt(path), "cannot read this file: its name has a zero byte");
  const Descriptor file(path);
  struct stat about {};
  if (file.value() < 0 || ::fstat(file.value(), &about) != 0)
    fail(path, std::string("cannot read this file: ") + std::strerror(errno));
  if (!S_ISREG(about.st_mode)) fail(path, "cannot read this: it is no regular file");
  const std::string most = "must be at most " + std::to_string(kMostSceneBytes) + " bytes";
  if (about.st_size > static_cast<off_t>(kMostSceneBytes))
    fail(path, most + ", got " + std::to_string(about.st_size));
  std::string text(static_cast<std::size_t>(about.st_size) + 1, '\0');
  std::size_t size = 0;
  while (size <= kMostSceneBytes) {
    if (size == text.size()) text.resize(2 * size);  // the file grows, or reports no size
    const ssize_t count = ::read(file.value(), &text[size], text.size() - size);
    if (count == 0) break;
    if (count < 0 && errno != EINTR)
      fail(path, std::string("cannot read this file: ") + std::strerror(errno));
    if (count > 0) size += static_cast<std::size_t>(count);
  }
  if (size > kMostSceneBytes) fail(path, most);
  text.resize(size);
  return text;
}

std::string joined(const std::vector<std::string>& words) {
  std::string text;
  for (const std::string& word : words) text += (text.empty() ? "" : ", ") + word;
  return text;
}

}  // namespace

World load_scene_file(const std::string& path, const WorldOptions& defaults) {
  return load_scene(text_of_file(path), path, defaults);
}

std::vector<std::string> scene_names(const std::string& folder) {
  std::vector<std::string> names;
  std::error_code error;  // no error for a missing folder
  for (fs::directory_iterator file(folder, error), end; !error && file != end;
       file.increment(error))
    if (file->path().extension() == ".yaml") names.push_back(file->path().stem().string());
  std::sort(names.begin(), names.end());
  return names;
}

std::string file_of_scene(const std::string& scene, const std::string& folder) {
  const std::vector<std::string> names = scene_names(folder);
  if (std::find(names.begin(), names.end(), scene) != names.end())
    return folder + "/" + scene + ".yaml";
  std::error_code error;
  const bool is_path = scene.find('/') != std::string::npos || fs::exists(scene, error);
  if (is_path || names.empty()) return scene;

  constexpr std::size_t kLongest = 64;
  std::vector<std::string> near;
  if (scene.size() <= kLongest)
    for (const std::string& name : names)
      if (edit_distance(scene, name) <= 1 + name.size() / 4 || name.rfind(scene, 0) == 0)
        near.push_back(name);
  const std::string what = "there is no such file or scene";
  fail(excerpt(scene), near.empty() ? what + "; there are " + joined(names)
                                    : what + "; did you mean " + joined(near) + "?");
}

}  // namespace constraint_sim::engine
