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
  std::string scene;  ///< path, package:// or name of a shipped scene; empty: an empty world
  double time_step = engine::WorldOptions{}.time_step;  ///< [s] unless the scene sets it
  double real_time_factor = 1.0;                        ///< 0: as fast as possible
  double publish_rate = 50.0;                           ///< [Hz]
  bool publish_tf = true;
  bool publish_clock = false;
  bool paused = false;
  std::string world_frame = "world";
  std::string frame_prefix;
  double closing_time = engine::WorldOptions{}.closing_time;  ///< [s] unless the scene sets it
  /// Share of the requested real-time factor below which /diagnostics warns.
  double diagnostics_real_time_factor = 0.9;
  double diagnostics_constraint_error = 1e-3;  ///< [m] above which /diagnostics warns
  bool hands = true;                           ///< whether bodies can be dragged in rviz
  std::string scene_folder;  ///< folder that contains all paths in services; empty: any folder
  std::string robot;         ///< URDF: path, package://, shipped robot, or name of a parameter
  std::string
      robot_extra;  ///< path of the YAML with extra settings; empty: the one beside the URDF
  std::string robot_prefix;                            ///< prefix of the names of links and joints
  bool robot_fixed = false;                            ///< the root link does not move
  double robot_x = 0.0, robot_y = 0.0, robot_z = 0.0;  ///< position of the root link [m]
  std::string publish_links = "all";  ///< all | root | none: frames of robots' links
  bool publish_com = false;           ///< publish frames of centres of mass, as children of links
  // Lists of names, separated by spaces.
  std::string command;               ///< constraints with a topic command/<constraint>
  std::string cmd_vel;               ///< kinematic bodies with a topic cmd_vel/<body>
  std::string wrench;                ///< bodies with a topic wrench/<body>
  std::string odometry;              ///< bodies and links with a topic odometry/<body>
  double goal_tolerance = 0.01;      ///< tolerance at the end of a trajectory [m or rad]; 0: none
  double goal_time_tolerance = 1.0;  ///< tolerance of the time of the end [s]
  std::string plugins;               ///< plugin classes of other packages, by their pluginlib names
  std::string follow;                ///< BODY=FRAME: kinematic bodies that follow frames of tf
  double follow_delay = 0.1;         ///< delay of the followed frames [s]

  bool use_sim_time = false;  ///< the global parameter, read only

  /// Returns whether stamps are simulated time instead of wall time.
  bool stamps_simulated_time() const { return publish_clock || use_sim_time; }
  /// Returns whether /clock drives the simulation.
  bool follows_clock() const { return use_sim_time && !publish_clock; }
};

/// Splits a parameter into its names.
std::vector<std::string> names_in(const std::string& parameter);

/// Splits the parameter `follow` into bodies and their frames. Throws ParameterError.
std::vector<std::pair<std::string, std::string>> followed_in(const std::string& parameter);

/// An invalid parameter.
class ParameterError : public std::invalid_argument {
 public:
  ParameterError(const std::string& name, const std::string& message)
      : std::invalid_argument(message), name_(name) {}
  const std::string& name() const { return name_; }

 private:
  std::string name_;
};

/// The checks throw ParameterError for an invalid value.
void check_real_time_factor(double value);
void check_publish_rate(double value);

/// Returns the names of all private parameters.
std::vector<std::string> parameter_names();

/// Reads the parameters, and writes the effective ones back for `rosparam get`. Throws
/// ParameterError, and has then written nothing.
Parameters read_parameters(const ros::NodeHandle& private_handle);

/// Returns one sentence for each unknown private parameter, with the likely intended name.
std::vector<std::string> unknown_parameters(const ros::NodeHandle& private_handle);

/// Returns names and values of parameters that are neither default nor in `given`, as one text;
/// empty where there are none.
std::string parameters_not_given(const Parameters& parameters, const std::set<std::string>& given);

}  // namespace constraint_sim
