#pragma once

#include <vector>

#include "sensors/settings.h"

namespace constraint_sim::sensors {

/// Plugin of all sensors of one kind: those that the parameter `<kFolder>/sensors` of the node
/// names. A Sensor is made of the handle of that folder and its name, and reads the world in
/// stepped(world, host).
template <class Sensor>
class Sensors : public Plugin {
 public:
  void start(PluginHost& host) override {
    host_ = &host;
    const ros::NodeHandle handle(host.private_namespace() + "/" + Sensor::kFolder);
    for (const std::string& name : sensor_names(handle)) sensors_.emplace_back(handle, name);
  }
  void stepped(const engine::World& world) override {
    for (Sensor& sensor : sensors_) sensor.stepped(world, *host_);
  }

 private:
  PluginHost* host_ = nullptr;
  std::vector<Sensor> sensors_;
};

}  // namespace constraint_sim::sensors
