#pragma once

#include <ros/node_handle.h>

#include <string>

#include "constraint_sim/world.h"

namespace constraint_sim {

/// The node's private parameters; docs/ros.md documents them.
struct Parameters {
  std::string scene;  ///< path, package:// or the name of a shipped one; empty: an empty world
  double time_step = engine::WorldOptions{}.time_step;  ///< [s] unless the scene has its own
  double real_time_factor = 1.0;                        ///< 0: as fast as it can
  double publish_rate = 50.0;                           ///< [Hz]
  bool paused = false;
  std::string world_frame = "world";
  std::string frame_prefix;
};

/// Throws std::invalid_argument naming the parameter and value that cannot be.
Parameters read_parameters(const ros::NodeHandle& private_handle);

/// The world that a scene describes. `text` unless empty, else the file that `name` stands for: a
/// path, package://PACKAGE/PATH, or a shipped scene; neither: an empty world. Throws
/// std::invalid_argument.
engine::World load_world(const std::string& name, const std::string& text, double time_step);

}  // namespace constraint_sim
