#pragma once

#include <boost/program_options.hpp>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "constraint_sim/engine/world.h"
#include "runner/robot.h"

namespace constraint_sim::engine {

/// The command line of constraint_sim_run.
struct Arguments {
  std::string scene;
  double duration = 0.0;                          ///< [s]
  boost::program_options::variables_map options;  ///< world options that replace those of the scene
  /// Paths of outputs; empty: no output.
  std::string csv, constraint_csv, report, save, snapshot;
  RobotArguments robot;
  bool explain = false, verify = false;
};

/// Parses the command line; none where only help was requested.
std::optional<Arguments> parse(int argc, char** argv);

/// Returns what load() reads, with its path: the scene, and files of a robot. Standard input has no
/// path. Throws SceneError where there is no such scene.
std::vector<std::pair<std::string, std::string>> files_read(const Arguments& arguments);

/// Loads the scene, and replaces its options by those of the command line.
World load(const Arguments& arguments);

}  // namespace constraint_sim::engine
