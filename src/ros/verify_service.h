#pragma once

#include <constraint_sim/Verify.h>
#include <ros/node_handle.h>
#include <ros/service_server.h>

#include <atomic>

#include "sim/stepper.h"

namespace constraint_sim {

/// The service `verify`: runs the next ticks of the world again on copies, on the calling thread,
/// while the stepping thread goes on. One verification runs at a time.
class VerifyService {
 public:
  static constexpr std::uint32_t kMostSteps = 100000;

  VerifyService(Stepper& stepper, ros::NodeHandle handle);

  /// Ends the present verification, and rejects later ones.
  void stop();

 private:
  bool verify(VerifyRequest& request, VerifyResponse& response);
  void run(std::uint32_t steps, VerifyResponse* response);

  Stepper& stepper_;
  std::atomic<bool> is_running_{false}, stopping_{false};
  std::atomic<bool> cancel_{false};  // stops the present verification; false while none runs
  ros::ServiceServer server_;
};

}  // namespace constraint_sim
