#pragma once

#include <string>

#include "constraint_sim/engine/custom.h"
#include "constraint_sim/engine/world.h"

namespace constraint_sim {

/// What the node offers to a plugin while it starts.
class PluginHost {
 public:
  virtual ~PluginHost() = default;
  /// The node's private namespace: parameters and topics of the plugin belong below it, in a
  /// namespace of its own.
  virtual std::string private_namespace() const = 0;
  /// Make types known, which scenes and services then use by name; as
  /// engine::register_custom_constraint() and engine::register_custom_force(), which a plugin does
  /// not call itself: a library has an engine of its own.
  virtual void add_constraint_type(const std::string& type,
                                   engine::CustomConstraintFactory factory) = 0;
  virtual void add_force_type(const std::string& type, engine::CustomForceFactory factory) = 0;
};

/// A class of another package that the node loads by pluginlib, for each name in its parameter
/// `plugins`. It adds types of constraints and forces, and senses what moves. What goes into the
/// motion goes through types, whose names and parameters scenes, snapshots, logs and the state hash
/// have: a plugin keeps nothing that the motion depends on.
class Plugin {
 public:
  virtual ~Plugin() = default;
  /// Once, before the first scene is loaded. What this throws ends the node with a message.
  virtual void start(PluginHost& host) = 0;
  /// After each step, on the stepping thread: be short. What this throws is logged with the
  /// plugin's name, and it is not called again.
  virtual void stepped(const engine::World& /*world*/) {}
};

}  // namespace constraint_sim
