#pragma once

#include <memory>
#include <string>
#include <vector>

#include "constraint_sim/plugin.h"
#include "ros/parameters.h"

namespace constraint_sim {

/// The classes of other packages that the parameter `plugins` names. Their libraries stay loaded
/// for as long as the process lives, since worlds keep functions of them.
class Plugins {
 public:
  /// Throws ParameterError for a class that is not there, or does not start.
  Plugins(const Parameters& parameters, const ros::NodeHandle& private_handle);

  void stepped(const engine::World& world);

 private:
  struct Loaded {
    std::string name;
    std::unique_ptr<Plugin> plugin;
    bool has_failed = false;
  };
  std::vector<Loaded> plugins_;
};

}  // namespace constraint_sim
