#pragma once

#include <cstddef>
#include <stdexcept>
#include <string>
#include <vector>

#include "constraint_sim/engine/world.h"

namespace constraint_sim::engine {

/// A scene that cannot be. what() is `file:line: path.of.key: what is wrong, with the value`,
/// without a line where there is no file to read.
class SceneError : public std::invalid_argument {
 public:
  using std::invalid_argument::invalid_argument;
};

/// What yaml-cpp reads within a second, and 10 000 bodies fit in: as people write them in 1 MiB, as
/// they are saved in motion in 5.5 MiB.
inline constexpr std::size_t kMostSceneBytes = std::size_t{6} << 20;

/// Makes a world from a scene in YAML (docs/scenes.md). `source` names it in errors.
/// `defaults` are the options of a scene that does not set them itself. Throws SceneError, also
/// when the text is longer than kMostSceneBytes, or has lists and maps more than 32 deep.
World load_scene(const std::string& text, const std::string& source = "scene",
                 const WorldOptions& defaults = {});

/// The same as load_scene() from a file. Throws SceneError, also when this is no regular file of at
/// most kMostSceneBytes that can be read.
World load_scene_file(const std::string& path, const WorldOptions& defaults = {});

/// The names that the scenes in a folder have: of `pendulum.yaml` it is `pendulum`. In their order.
std::vector<std::string> scene_names(const std::string& folder);

/// The file that `scene` stands for: the scene of that name in `folder`, or else itself, a path.
/// Throws SceneError where there is neither, with the names in the folder that may be meant.
std::string file_of_scene(const std::string& scene, const std::string& folder);

/// The world as it is now, as a scene in long form: loading it gives the same bodies, joints and
/// motion, every number to 4 ulp, and saving that again gives the same text.
std::string save_scene(const World& world);

}  // namespace constraint_sim::engine
