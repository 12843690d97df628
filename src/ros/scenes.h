#pragma once

#include <string>
#include <vector>

#include "constraint_sim/engine/world.h"
#include "ros/parameters.h"

namespace constraint_sim {

/// Who names a scene: the parameter when the node starts, which may lie anywhere, or a service,
/// whose paths stay below `scene_folder`.
enum class Caller { kParameter, kService };

/// Names of the scenes that come with the package, sorted.
std::vector<std::string> shipped_scenes();

/// Names of the files of a folder that have this ending, without it, sorted.
std::vector<std::string> names_in_folder(const std::string& folder, const std::string& ending);
/// The first comment of a shipped scene, as one line.
std::string description(const std::string& scene);
/// The file that a path or package://PACKAGE/PATH stands for; in parameters `~/` is the home
/// folder. Throws std::invalid_argument.
std::string file_named(const std::string& name, const Parameters& parameters, Caller caller);

/// The world that a scene describes. `text` unless empty, else the file that `name` stands for: a
/// path, package://PACKAGE/PATH, or a shipped scene; neither: an empty world. Throws
/// std::invalid_argument, with at most 40 characters of the file.
engine::World load_world(const std::string& name, const std::string& text,
                         const Parameters& parameters, Caller caller);

/// One line: what is in a world, and how it is stepped.
std::string summary(const engine::World& world);

}  // namespace constraint_sim
