#include "ros/plugins.h"

#include <ros/console.h>

#include <pluginlib/class_loader.hpp>
#include <utility>

#include "sim/errors.h"

namespace constraint_sim {
namespace {

using Loader = pluginlib::ClassLoader<Plugin>;

// Returns the loader, which is never destroyed: its destructor would unload the libraries.
Loader& loader() {
  static auto* const kLoader = new Loader("constraint_sim", "constraint_sim::Plugin");
  return *kLoader;
}

}  // namespace

class Plugins::Host : public PluginHost {
 public:
  explicit Host(std::string private_namespace) : namespace_(std::move(private_namespace)) {}
  std::string private_namespace() const override { return namespace_; }
  std::int64_t stamp() const override { return stamp_; }
  void set_stamp(std::int64_t stamp) { stamp_ = stamp; }
  void add_constraint_type(const std::string& type,
                           engine::CustomConstraintFactory factory) override {
    engine::register_custom_constraint(type, std::move(factory));
  }
  void add_force_type(const std::string& type, engine::CustomForceFactory factory) override {
    engine::register_custom_force(type, std::move(factory));
  }

 private:
  std::string namespace_;
  std::int64_t stamp_ = 0;  // [ns]
};

Plugins::Plugins(const Parameters& parameters, const ros::NodeHandle& private_handle)
    : host_(std::make_shared<Host>(private_handle.getNamespace())) {
  for (const std::string& name : names_in(parameters.plugins)) {
    try {
      plugins_.push_back({name, std::unique_ptr<Plugin>(loader().createUnmanagedInstance(name))});
      plugins_.back().plugin->start(*host_);
    } catch (...) {
      throw ParameterError("plugins",
                           "parameter ~plugins: '" + name + "': " + message_of_exception());
    }
    ROS_INFO("plugin %s", name.c_str());
  }
}

void Plugins::stepped(const engine::World& world, const ros::Time& stamp) {
  host_->set_stamp(static_cast<std::int64_t>(stamp.toNSec()));
  for (Loaded& loaded : plugins_) {
    if (loaded.has_failed) continue;
    try {
      loaded.plugin->stepped(world);
    } catch (...) {
      loaded.has_failed = true;
      ROS_ERROR("plugin %s threw and is not called again: %s", loaded.name.c_str(),
                message_of_exception().c_str());
    }
  }
}

}  // namespace constraint_sim
