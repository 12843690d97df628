#pragma once

#include <cstdlib>
#include <fstream>
#include <sstream>
#include <string>

#include "temporary_folder.h"

namespace constraint_sim::report {

/// Runs Python with these arguments; returns nothing where it succeeds, else command and output.
inline std::string run_python(const std::string& arguments) {
  const engine::TemporaryFolder folder;
  const std::string log = folder.path() + "/log";
  const std::string command = "/usr/bin/python3 " + arguments + " >" + log + " 2>&1";
  const int status = std::system(command.c_str());
  std::ifstream file(log);
  std::stringstream text;
  text << file.rdbuf();
  return status == 0 ? "" : "failed: " + command + "\n" + text.str();
}

}  // namespace constraint_sim::report
