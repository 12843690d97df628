#pragma once

#include <ros/time.h>

#include <memory>
#include <string>
#include <vector>

#include "constraint_sim/plugin.h"
#include "ros/parameters.h"

namespace constraint_sim {

/// Plugin classes of other packages, named in the parameter `plugins`. Their libraries stay loaded
/// until the process ends, since worlds keep pointers to their functions.
class Plugins {
 public:
  /// Throws ParameterError for a class that is missing or does not start.
  Plugins(const Parameters& parameters, const ros::NodeHandle& private_handle);

  /// `stamp`: of the node's messages about the world.
  void stepped(const engine::World& world, const ros::Time& stamp);
  bool empty() const { return plugins_.empty(); }

 private:
  class Host;
  struct Loaded {
    std::string name;
    std::unique_ptr<Plugin> plugin;
    bool has_failed = false;
  };
  std::shared_ptr<Host> host_;
  std::vector<Loaded> plugins_;
};

}  // namespace constraint_sim
