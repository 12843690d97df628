#pragma once

#include <ros/node_handle.h>
#include <ros/subscriber.h>
#include <rosgraph_msgs/Clock.h>

#include <array>
#include <string>
#include <thread>

#include "ros/commands.h"
#include "ros/diagnostics.h"
#include "ros/edit_log.h"
#include "ros/edits.h"
#include "ros/event_log.h"
#include "ros/events.h"
#include "ros/frame_follower.h"
#include "ros/guarded.h"
#include "ros/hands.h"
#include "ros/parameters.h"
#include "ros/plugins.h"
#include "ros/publishers.h"
#include "ros/robots.h"
#include "ros/service_queue.h"
#ifdef CONSTRAINT_SIM_DYNAMIC_RECONFIGURE
#include "ros/reconfigure.h"
#endif
#include "ros/services.h"
#include "ros/urdf_loader.h"
#include "ros/verify_service.h"
#include "sim/stepper.h"

namespace constraint_sim {

/// The simulator as a ROS node: a stepper on its own thread, services on their own queues that edit
/// its world, topics that show it, and a log. Runs from construction to destruction.
class SimulatorNode {
 public:
  /// Throws ParameterError for an invalid parameter or scene.
  SimulatorNode(const ros::NodeHandle& handle, const ros::NodeHandle& private_handle);
  /// Answers all waiting callers.
  ~SimulatorNode();
  SimulatorNode(const SimulatorNode&) = delete;
  SimulatorNode& operator=(const SimulatorNode&) = delete;

  const Parameters& parameters() const { return parameters_; }

 private:
  World first_world();
  ServiceHandles service_handles();
  StepperEvents events();
  Stepper::Clock clock() const;
  Pacing pacing() const;
  void on_clock(const rosgraph_msgs::Clock& message);
  void move_time(World* world, double time);
  void tell_of_start(const std::string& world);

  ServiceQueue edits_, queries_, steps_, pauses_, verifications_;
  ServiceQueue clocks_;             // a thread of its own, so that messages of /clock do not wait
  std::atomic<double> clock_{0.0};  // time in the last message on /clock [s]
  ros::NodeHandle handle_;
  ros::NodeHandle private_handle_;
  Parameters parameters_;
  Plugins plugins_;  // first, since the first world may need them
  EventLog log_;
  std::string first_summary_;
  engine::WorldOptions first_options_;
  EditLog edit_log_;
  Hands hands_;
  Robots robots_;
  Publishers publishers_;
  EventTopic event_topic_;
  Diagnostics diagnostics_;
  Stepper stepper_;
  Services services_;
  VerifyService verify_service_;
#ifdef CONSTRAINT_SIM_DYNAMIC_RECONFIGURE
  Reconfigure reconfigure_;
#endif
  UrdfLoader urdf_loader_;
  Commands commands_;
  FrameFollower follower_;
  ros::Subscriber clock_topic_;
  SharedGuard clock_guard_ = make_guard("/clock");
  Guard follow_guard_{"follow"};
  std::thread stepping_thread_;
};

}  // namespace constraint_sim
