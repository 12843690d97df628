#include "ros/simulator_node.h"

namespace constraint_sim {
namespace {

constexpr unsigned kServiceThreads = 4;

// [s] of a followed clock that may be made up for: it may come in large steps
constexpr double kMaxCatchUpWithClock = 1.0;

StepperOptions stepper_options(const Parameters& parameters) {
  StepperOptions options;
  options.real_time_factor = parameters.real_time_factor;
  options.paused = parameters.paused;
  if (parameters.follows_clock()) options.max_catch_up = kMaxCatchUpWithClock;
  return options;
}

ros::NodeHandle with_queue(ros::NodeHandle handle, ros::CallbackQueue* queue) {
  handle.setCallbackQueue(queue);
  return handle;
}

}  // namespace

SimulatorNode::SimulatorNode(const ros::NodeHandle& handle, const ros::NodeHandle& private_handle)
    : handle_(with_queue(handle, &queue_)),
      private_handle_(with_queue(private_handle, &queue_)),
      parameters_(read_parameters(private_handle_)),
      publishers_(parameters_, handle_, private_handle_),
      stepper_(load_world(parameters_.scene, "", parameters_), stepper_options(parameters_),
               clock(), events()),
      services_(stepper_, publishers_, parameters_, private_handle_),
      spinner_(kServiceThreads, &queue_),
      stepping_thread_(&Stepper::run, &stepper_) {
  if (parameters_.follows_clock())
    clock_topic_ = handle_.subscribe("/clock", 10, &SimulatorNode::on_clock, this);
  spinner_.start();
}

SimulatorNode::~SimulatorNode() {
  stepper_.stop();  // answers the services that wait, so that the spinner can end
  stepping_thread_.join();
  spinner_.stop();
}

Stepper::Clock SimulatorNode::clock() const {
  if (parameters_.follows_clock()) return [] { return ros::Time::now().toSec(); };
  return [] { return ros::SteadyTime::now().toSec(); };
}

// Simulated time begins with the clock that is followed, and goes back with it.
void SimulatorNode::on_clock(const rosgraph_msgs::Clock& message) {
  const double clock = message.clock.toSec();
  try {
    if (clock_ == 0.0 || clock < clock_)
      stepper_.post([clock](World& world) { world.set_time(clock, world.step_count()); });
  } catch (const Cancelled&) {
    return;
  }
  clock_ = clock;
  stepper_.wake();
}

StepperEvents SimulatorNode::events() {
  StepperEvents events;
  events.stepped = [this](const World& world, double seconds) {
    publishers_.stepped(world, seconds);
  };
  events.edited = [this](const World& world) { publishers_.edited(world); };
  events.passed = [this](const World& world) {
    stepper_.time_stages(publishers_.wants_stage_times());
    return publishers_.passed(world, stepper_);
  };
  return events;
}

}  // namespace constraint_sim
