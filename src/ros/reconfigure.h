#pragma once

#include <constraint_sim/SetOptionsRequest.h>
#include <constraint_sim/SetOptionsResponse.h>
#include <dynamic_reconfigure/Config.h>
#include <dynamic_reconfigure/Reconfigure.h>
#include <ros/node_handle.h>

#include <functional>
#include <mutex>

#include "constraint_sim/engine/options.h"
#include "ros/edits.h"

namespace constraint_sim {

/// Every option of set_options as a parameter of dynamic_reconfigure, gravity as gravity_x,
/// gravity_y and gravity_z. What is set there becomes one request of set_options, so that both
/// check alike; a call with a value that cannot be fails, changes nothing, and the log says why.
/// It has no defaults of its own that could replace what launch file and scene say.
class Reconfigure {
 public:
  using SetOptions = std::function<SetOptionsResponse(SetOptionsRequest&)>;

  /// Begins with the options of the first world, and of the node.
  Reconfigure(const ros::NodeHandle& private_handle, const engine::WorldOptions& options,
              const Pacing& pacing, SetOptions set_options);

  /// Tells who listens where an option has changed, whoever did it. On the stepping thread.
  void edited(const engine::WorldOptions& options, const Pacing& pacing);

 private:
  bool set(dynamic_reconfigure::ReconfigureRequest& request,
           dynamic_reconfigure::ReconfigureResponse& response);
  dynamic_reconfigure::Config current() const;

  SetOptions set_options_;
  mutable std::mutex mutex_;
  dynamic_reconfigure::Config current_;
  ros::NodeHandle handle_;
  ros::Publisher descriptions_, updates_;
  ros::ServiceServer server_;
};

}  // namespace constraint_sim
