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

/// Returns options and pacing as parameters of dynamic_reconfigure.
dynamic_reconfigure::Config config_of(const engine::WorldOptions& options, const Pacing& pacing);
/// Returns a request of set_options with the parameters of `asked` that differ from `present`.
SetOptionsRequest request_of(const dynamic_reconfigure::Config& asked,
                             const dynamic_reconfigure::Config& present);

/// Options of set_options as parameters of dynamic_reconfigure, gravity as gravity_x, gravity_y and
/// gravity_z. A change becomes one request of set_options, so both check alike. A call with an
/// invalid value fails, changes nothing and is logged. There are no defaults that could replace
/// values of launch file and scene.
class Reconfigure {
 public:
  using SetOptions = std::function<SetOptionsResponse(SetOptionsRequest&)>;

  /// Starts with the options of the first world and of the node.
  Reconfigure(const ros::NodeHandle& private_handle, const engine::WorldOptions& options,
              const Pacing& pacing, SetOptions set_options);

  /// Publishes changed options, whichever call changed them. Stepping thread only.
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
