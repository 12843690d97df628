#include "ros/scenes.h"

#include <dirent.h>
#include <ros/package.h>

#include <algorithm>
#include <array>
#include <cstdio>
#include <cstdlib>
#include <sstream>
#include <stdexcept>

#include "constraint_sim/engine/scene.h"
#include "sim/files.h"
#include "sim/words.h"

namespace constraint_sim {
namespace {

std::string shipped_folder() { return ros::package::getPath("constraint_sim") + "/config/scenes/"; }

// Returns whether a relative path leaves its folder by "..", as a/../../b does.
bool leaves_its_start(const std::string& path) {
  int depth = 0;
  for (std::size_t begin = 0; begin <= path.size();) {
    const std::size_t end = std::min(path.find('/', begin), path.size());
    const std::string part = path.substr(begin, end - begin);
    if (part == "..")
      --depth;
    else if (!part.empty() && part != ".")
      ++depth;
    if (depth < 0) return true;
    begin = end + 1;
  }
  return false;
}

std::string file_in_package(const std::string& name, const std::string& rest) {
  const std::string package = rest.substr(0, rest.find('/'));
  const std::string folder = ros::package::getPath(package);
  if (folder.empty())
    throw std::invalid_argument("there is no package '" + shortened(package) + "' in '" +
                                shortened(name, 200) + "'");
  const std::string inside = rest.substr(package.size());
  if (leaves_its_start(inside))
    throw std::invalid_argument("'" + shortened(name, 200) + "' leaves its package");
  return folder + inside;
}

// Expands `~/`, which a shell leaves unexpanded within a word, as in `_robot:=~/arm.urdf`.
std::string in_home(const std::string& path) {
  const char* const home = std::getenv("HOME");
  return home != nullptr && path.compare(0, 2, "~/") == 0 ? home + path.substr(1) : path;
}

std::string file_of_scene(const std::string& name, const Parameters& parameters, Caller caller) {
  const std::vector<std::string> shipped = shipped_scenes();
  if (std::find(shipped.begin(), shipped.end(), name) != shipped.end())
    return shipped_folder() + name + ".yaml";
  return file_named(name, parameters, caller);
}

std::string count_of(std::size_t count, const char* one, const char* several) {
  return std::to_string(count) + " " + (count == 1 ? one : several);
}

engine::World load_file(const std::string& name, const Parameters& parameters, Caller caller,
                        const engine::WorldOptions& defaults) {
  std::string path, text;
  try {
    path = file_of_scene(name, parameters, caller);
    text = read_file(path);
  } catch (const std::invalid_argument& error) {
    if (name.find('/') != std::string::npos) throw;
    const std::vector<std::string> shipped = shipped_scenes();
    std::string message = error.what();
    message += ", and no scene of that name comes with the package" + did_you_mean(name, shipped) +
               " There are";
    for (const std::string& scene : shipped) message += " " + scene;
    throw std::invalid_argument(message);
  }
  try {
    return engine::load_scene(text, path, defaults);
  } catch (const engine::SceneError& error) {
    throw std::invalid_argument(with_short_quotes(error.what(), path.size()));
  }
}

}  // namespace

std::vector<std::string> shipped_scenes() { return names_in_folder(shipped_folder(), ".yaml"); }

std::vector<std::string> names_in_folder(const std::string& folder, const std::string& ending) {
  std::vector<std::string> names;
  DIR* const files = ::opendir(folder.c_str());
  if (files == nullptr) return names;
  while (const dirent* entry = ::readdir(files)) {
    const std::string file = entry->d_name;
    if (file.size() > ending.size() &&
        file.compare(file.size() - ending.size(), ending.size(), ending) == 0)
      names.push_back(file.substr(0, file.size() - ending.size()));
  }
  ::closedir(files);
  std::sort(names.begin(), names.end());
  return names;
}

std::string description(const std::string& scene) {
  std::istringstream text(read_file(shipped_folder() + scene + ".yaml"));
  std::string line, description;
  while (std::getline(text, line) && line.compare(0, 2, "# ") == 0)
    description += (description.empty() ? "" : " ") + line.substr(2);
  return description;
}

std::string file_named(const std::string& name, const Parameters& parameters, Caller caller) {
  const std::string scheme = "package://";
  if (name.compare(0, scheme.size(), scheme) == 0)
    return file_in_package(name, name.substr(scheme.size()));
  if (caller == Caller::kParameter) return in_home(name);
  return parameters.scene_folder.empty() ? name : path_below(parameters.scene_folder, name);
}

bool has_scene(const std::string& name) { return !name.empty() && name != "none"; }

engine::World load_world(const std::string& name, const std::string& text,
                         const Parameters& parameters, Caller caller) {
  engine::WorldOptions defaults;
  defaults.time_step = parameters.time_step;
  defaults.closing_time = parameters.closing_time;
  if (text.size() > kMostBytes)
    throw std::invalid_argument("text: must be at most " + std::to_string(kMostBytes >> 20) +
                                " MiB, got " + std::to_string(text.size()) + " bytes");
  if (!text.empty()) return engine::load_scene(text, "text", defaults);
  if (has_scene(name)) return load_file(name, parameters, caller, defaults);
  return engine::World(defaults);
}

std::string summary(const engine::World& world) {
  std::array<std::size_t, engine::kMethodCount> islands{};
  for (const engine::Island& island : world.islands())
    ++islands[static_cast<std::size_t>(island.method)];
  std::string methods;
  for (std::size_t i = 0; i < islands.size(); ++i)
    if (islands[i] > 0)
      methods += std::string(methods.empty() ? "" : ", ") +
                 engine::name(static_cast<engine::Method>(i)) + " for " +
                 count_of(islands[i], "island", "islands");
  char tick[32];
  std::snprintf(tick, sizeof tick, "%g", world.options().time_step);
  return count_of(world.body_ids().size(), "body", "bodies") + ", " +
         count_of(world.joint_ids().size(), "constraint", "constraints") + ", tick " + tick +
         " s, methods: " + (methods.empty() ? "none" : methods);
}

}  // namespace constraint_sim
