#pragma once

#include <ros/node_handle.h>

#include <set>
#include <stdexcept>
#include <string>
#include <utility>
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
  /// Of the one asked for, below which /diagnostics warns.
  double diagnostics_real_time_factor = 0.9;
  double diagnostics_constraint_error = 1e-3;  ///< [m] above which /diagnostics warns
  bool hands = true;                           ///< whether bodies can be dragged in rviz
  std::string scene_folder;  ///< that paths in services stay below; empty: anywhere
  std::string robot;         ///< URDF: path, package://, shipped, or the name of a parameter
  std::string robot_extra;   ///< path of the YAML beside it; empty: that beside the file
  std::string robot_prefix;  ///< before the names of its links and joints
  bool robot_fixed = false;  ///< its root does not move
  double robot_x = 0.0, robot_y = 0.0, robot_z = 0.0;  ///< of its root link [m]
  std::string publish_links = "all";  ///< all | root | none: frames of robots' links
  bool publish_com = false;           ///< frames of their bodies, as children of links
  // names, with spaces between them
  std::string command;        ///< constraints with a topic command/<constraint>
  std::string cmd_vel;        ///< kinematic bodies with a topic cmd_vel/<body>
  std::string wrench;         ///< bodies with a topic wrench/<body>
  std::string odometry;       ///< bodies and links with a topic odometry/<body>
  std::string plugins;        ///< classes of other packages, as pluginlib names them
  std::string follow;         ///< BODY=FRAME: kinematic bodies that follow frames of tf
  double follow_delay = 0.1;  ///< [s] by which they are behind

  bool use_sim_time = false;  ///< the global one, read and not set

  /// Whether stamps are simulated time, and not the wall's.
  bool stamps_simulated_time() const { return publish_clock || use_sim_time; }
  /// Whether /clock drives the simulation.
  bool follows_clock() const { return use_sim_time && !publish_clock; }
};

/// The names in a parameter that has several.
std::vector<std::string> names_in(const std::string& parameter);

/// Of the parameter `follow` the bodies and their frames. Throws ParameterError.
std::vector<std::pair<std::string, std::string>> followed_in(const std::string& parameter);

/// A parameter that cannot be.
class ParameterError : public std::invalid_argument {
 public:
  ParameterError(const std::string& name, const std::string& message)
      : std::invalid_argument(message), name_(name) {}
  const std::string& name() const { return name_; }

 private:
  std::string name_;
};

/// Each throws ParameterError for a value that cannot be.
void check_real_time_factor(double value);
void check_publish_rate(double value);

/// Names of all private parameters.
std::vector<std::string> parameter_names();

/// Reads the parameters and writes those in effect back, for `rosparam get` to show. Throws
/// ParameterError, and has then written nothing.
Parameters read_parameters(const ros::NodeHandle& private_handle);

/// Of the private parameters that no simulator has, one sentence each, with what may be meant.
std::vector<std::string> unknown_parameters(const ros::NodeHandle& private_handle);

/// Those that are not the default and not among `given`, with their values, as one text; empty
/// where there are none.
std::string parameters_not_given(const Parameters& parameters, const std::set<std::string>& given);

}  // namespace constraint_sim
