#include "ros/simulator_node.h"

namespace constraint_sim {
namespace {

constexpr unsigned kServiceThreads = 4;

ros::NodeHandle with_queue(ros::NodeHandle handle, ros::CallbackQueue* queue) {
  handle.setCallbackQueue(queue);
  return handle;
}

}  // namespace

SimulatorNode::SimulatorNode(ros::NodeHandle handle, ros::NodeHandle private_handle)
    : handle_(with_queue(handle, &queue_)),
      private_handle_(with_queue(private_handle, &queue_)),
      parameters_(read_parameters(private_handle_)),
      publishers_(parameters_, handle_, private_handle_),
      stepper_(
          load_world(parameters_.scene, "", parameters_.time_step),
          {parameters_.real_time_factor, parameters_.paused},
          [] { return ros::SteadyTime::now().toSec(); }, events()),
      services_(stepper_, parameters_, private_handle_),
      spinner_(kServiceThreads, &queue_),
      stepping_thread_(&Stepper::run, &stepper_) {
  spinner_.start();
}

SimulatorNode::~SimulatorNode() {
  stepper_.stop();  // answers the services that wait, so that the spinner can end
  stepping_thread_.join();
  spinner_.stop();
}

StepperEvents SimulatorNode::events() {
  StepperEvents events;
  events.stepped = [this](const World& world, double seconds) {
    publishers_.stepped(world, seconds);
  };
  events.edited = [this](const World&) { publishers_.edited(); };
  events.passed = [this](const World& world) {
    publishers_.passed(world, stepper_);
    stepper_.time_stages(publishers_.wants_stage_times());
  };
  return events;
}

}  // namespace constraint_sim
