#pragma once

#include <string>

#include "constraint_sim/engine/scene.h"
#include "test_paths.h"

namespace constraint_sim::engine {

/// Returns a scene of config/scenes.
inline World shipped(const std::string& scene) {
  return load_scene_file(CONSTRAINT_SIM_SCENE_DIR "/" + scene + ".yaml");
}

inline World shipped(const std::string& scene, Method method) {
  World world = shipped(scene);
  WorldOptions options = world.options();
  options.method = method;
  if (options.method != world.options().method) world.set_options(options);
  return world;
}

}  // namespace constraint_sim::engine
