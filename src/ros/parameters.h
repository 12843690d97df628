#pragma once

#include <ros/node_handle.h>

#include <set>
#include <stdexcept>
#include <string>
#include <vector>

#include "constraint_sim/engine/world.h"

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
  std::string scene_folder;   ///< that paths in services stay below; empty: anywhere
  bool use_sim_time = false;  ///< the global one, read and not set

  /// Whether stamps are simulated time, and not the wall's.
  bool stamps_simulated_time() const { return publish_clock || use_sim_time; }
  /// Whether /clock drives the simulation.
  bool follows_clock() const { return use_sim_time && !publish_clock; }
};

/// A parameter that cannot be.
class ParameterError : public std::invalid_argument {
 public:
  ParameterError(const std::string& name, const std::string& message)
      : std::invalid_argument(message), name_(name) {}
  const std::string& name() const { return name_; }

 private:
  std::string name_;
};

/// Reads the parameters and writes those in effect back, for `rosparam get` to show. Throws
/// ParameterError, and has then written nothing.
Parameters read_parameters(const ros::NodeHandle& private_handle);

/// Of the private parameters that no simulator has, one sentence each, with what may be meant.
std::vector<std::string> unknown_parameters(const ros::NodeHandle& private_handle);

/// Those that are not the default and not among `given`, with their values, as one text; empty
/// where there are none.
std::string parameters_not_given(const Parameters& parameters, const std::set<std::string>& given);

}  // namespace constraint_sim
