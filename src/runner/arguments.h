#pragma once

#include <boost/program_options.hpp>
#include <optional>
#include <string>

#include "constraint_sim/engine/world.h"

namespace constraint_sim::engine {

/// The command line of constraint_sim_run.
struct Arguments {
  std::string scene;
  double duration = 0.0;                          ///< [s]
  boost::program_options::variables_map options;  ///< of the world, in place of the scene's
  /// Paths; empty: not wanted.
  std::string csv, constraint_csv, report, save, snapshot;
  bool explain = false, verify = false;
};

/// Nothing when only help was asked for.
std::optional<Arguments> parse(int argc, char** argv);

/// The file that the scene is read from; empty of standard input. Throws SceneError where there is
/// none.
std::string file_of(const Arguments& arguments);

/// The scene, with the options of the command line in place of its own.
World load(const Arguments& arguments);

}  // namespace constraint_sim::engine
