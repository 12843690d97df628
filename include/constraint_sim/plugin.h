#pragma once

#include <cstdint>
#include <string>

#include "constraint_sim/engine/custom.h"
#include "constraint_sim/engine/world.h"

namespace constraint_sim {

/// Interface of the node for a plugin during its start.
class PluginHost {
 public:
  virtual ~PluginHost() = default;
  /// Returns the node's private namespace. Parameters and topics of the plugin belong below it, in
  /// a namespace of its own.
  virtual std::string private_namespace() const = 0;
  /// Returns the stamp of the node's messages about the last step [ns]: simulated time with
  /// `publish_clock` or `use_sim_time`, else wall time. Call within Plugin::stepped().
  virtual std::int64_t stamp() const = 0;
  /// Register a type, which scenes and services then use by name. A plugin calls these functions
  /// and not engine::register_custom_constraint() or engine::register_custom_force(), since its
  /// library has an engine of its own.
  virtual void add_constraint_type(const std::string& type,
                                   engine::CustomConstraintFactory factory) = 0;
  virtual void add_force_type(const std::string& type, engine::CustomForceFactory factory) = 0;
};

/// A class of another package that the node loads by pluginlib, for each name in its parameter
/// `plugins`. A plugin adds types of constraints and forces, and observes the motion. Whatever
/// affects the motion is a parameter of a type, kept by scenes, snapshots, logs and the state hash;
/// a plugin keeps no state that the motion depends on.
class Plugin {
 public:
  virtual ~Plugin() = default;
  /// Called once, before the first scene is loaded. The host lives as long as the plugin. An
  /// exception ends the node with a message.
  virtual void start(PluginHost& host) = 0;
  /// Called after each step, on the stepping thread; must be short. An exception is logged with the
  /// plugin's name and ends the calls.
  virtual void stepped(const engine::World& /*world*/) {}
};

}  // namespace constraint_sim
