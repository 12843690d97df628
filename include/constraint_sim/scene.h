#pragma once

#include <stdexcept>
#include <string>

#include "constraint_sim/world.h"

namespace constraint_sim::engine {

/// A scene that cannot be. what() is `file:line: path.of.key: what is wrong, with the value`,
/// without a line where there is no file to read.
class SceneError : public std::invalid_argument {
 public:
  using std::invalid_argument::invalid_argument;
};

/// Makes a world from a scene in YAML (docs/scenes.md). `source` names it in errors.
/// `defaults` are the options of a scene that does not set them itself. Throws SceneError.
World load_scene(const std::string& text, const std::string& source = "scene",
                 const WorldOptions& defaults = {});

/// The same from a file. Throws SceneError, also when the file cannot be read.
World load_scene_file(const std::string& path, const WorldOptions& defaults = {});

/// The world as it is now, as a scene in long form: loading it gives the same bodies, joints and
/// motion, every number to 4 ulp, and saving that again gives the same text.
std::string save_scene(const World& world);

}  // namespace constraint_sim::engine
