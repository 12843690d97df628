#pragma once

#include <cstddef>
#include <stdexcept>
#include <string>
#include <vector>

#include "constraint_sim/engine/world.h"

namespace constraint_sim::engine {

/// Error of a scene. what() is `file:line: path.of.key: what is wrong, with the value`, without a
/// line where there is no file.
class SceneError : public std::invalid_argument {
 public:
  using std::invalid_argument::invalid_argument;
};

/// Largest size of a scene in bytes. yaml-cpp reads it within a second, and it holds 10 000 bodies,
/// which take 1 MiB as written by hand and 5.5 MiB as saved in motion.
inline constexpr std::size_t kMostSceneBytes = std::size_t{6} << 20;

/// Makes a world from a scene in YAML (docs/scenes.md). `source` names the scene in errors;
/// `defaults` are options that the scene does not set. Throws SceneError, also for a text longer
/// than kMostSceneBytes, or with lists and maps more than 32 deep.
World load_scene(const std::string& text, const std::string& source = "scene",
                 const WorldOptions& defaults = {});

/// Calls load_scene() on the text of a file. Throws SceneError, also where the path is no readable
/// regular file of at most kMostSceneBytes.
World load_scene_file(const std::string& path, const WorldOptions& defaults = {});

/// Lists the names of the scenes in a folder, sorted: `pendulum` for `pendulum.yaml`.
std::vector<std::string> scene_names(const std::string& folder);

/// Returns the file that `scene` stands for: the scene of that name in `folder`, or `scene` as a
/// path. Throws SceneError for a name that is neither, with names in the folder as suggestions.
std::string file_of_scene(const std::string& scene, const std::string& folder);

/// Writes the present world as a scene in long form. Loading it gives the same bodies, joints and
/// motion, every number to 4 ulp, and saving it again gives the same text.
std::string save_scene(const World& world);

}  // namespace constraint_sim::engine
