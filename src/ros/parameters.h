#pragma once

#include <ros/node_handle.h>

#include <string>

#include "constraint_sim/world.h"

namespace constraint_sim {

/// The node's private parameters; config/parameters.yaml is their manual.
struct Parameters {
  std::string scene;  ///< path, package:// or the name of a shipped one; empty: an empty world
  double time_step = engine::WorldOptions{}.time_step;  ///< [s] unless the scene has its own
  double real_time_factor = 1.0;                        ///< 0: as fast as it can
  double publish_rate = 50.0;                           ///< [Hz]
  bool publish_tf = true;
  bool publish_clock = false;
  bool paused = false;
  std::string world_frame = "world";
  std::string frame_prefix;
  double closing_time = engine::WorldOptions{}.closing_time;  ///< [s] unless the scene has its own
  bool use_sim_time = false;                                  ///< the global one, read and not set

  /// Whether stamps are simulated time, and not the wall's.
  bool stamps_simulated_time() const { return publish_clock || use_sim_time; }
  /// Whether /clock drives the simulation.
  bool follows_clock() const { return use_sim_time && !publish_clock; }
};

/// Reads the parameters and writes those in effect back, for `rosparam get` to show. Throws
/// std::invalid_argument naming the parameter and value that cannot be.
Parameters read_parameters(const ros::NodeHandle& private_handle);

/// The world that a scene describes. `text` unless empty, else the file that `name` stands for: a
/// path, package://PACKAGE/PATH, or a shipped scene; neither: an empty world. Throws
/// std::invalid_argument.
engine::World load_world(const std::string& name, const std::string& text,
                         const Parameters& parameters);

}  // namespace constraint_sim
