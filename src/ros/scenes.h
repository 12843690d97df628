#pragma once

#include <string>
#include <vector>

#include "constraint_sim/engine/world.h"
#include "ros/parameters.h"

namespace constraint_sim {

/// Origin of a scene's name: the parameter at the start of the node, which may be any path, or a
/// service, whose paths stay below `scene_folder`.
enum class Caller { kParameter, kService };

/// Returns the names of the package's scenes, sorted.
std::vector<std::string> shipped_scenes();

/// Returns the names of files in a folder with this ending, without the ending, sorted.
std::vector<std::string> names_in_folder(const std::string& folder, const std::string& ending);
/// Returns the first comment of a shipped scene, as one line.
std::string description(const std::string& scene);
/// Returns the file for a path or package://PACKAGE/PATH; in parameters `~/` is the home folder.
/// Throws std::invalid_argument.
std::string file_named(const std::string& name, const Parameters& parameters, Caller caller);

/// Returns whether the name stands for a scene: empty and `none` stand for an empty world.
bool has_scene(const std::string& name);

/// Loads a scene: `text` unless empty, else the file that `name` stands for (a path,
/// package://PACKAGE/PATH or a shipped scene); an empty world where both are empty, and for the
/// name `none`. Throws std::invalid_argument, with at most 40 characters of the file.
engine::World load_world(const std::string& name, const std::string& text,
                         const Parameters& parameters, Caller caller);

/// Returns one line with the contents of a world and how it is stepped.
std::string summary(const engine::World& world);

}  // namespace constraint_sim
