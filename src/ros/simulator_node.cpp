#include "ros/simulator_node.h"

#include <ros/console.h>
#include <ros/subscriber.h>
#include <rosgraph_msgs/Clock.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <future>
#include <stdexcept>
#include <string>
#include <thread>
#include <vector>

#include "ros/commands.h"
#include "ros/diagnostics.h"
#include "ros/edit_log.h"
#include "ros/edits.h"
#include "ros/event_log.h"
#include "ros/events.h"
#include "ros/frame_follower.h"
#include "ros/guarded.h"
#include "ros/hands.h"
#include "ros/plugins.h"
#include "ros/publishers.h"
#ifdef CONSTRAINT_SIM_DYNAMIC_RECONFIGURE
#include "ros/reconfigure.h"
#endif
#include "ros/robots.h"
#include "ros/scenes.h"
#include "ros/service_queue.h"
#include "ros/services.h"
#include "ros/trajectory_actions.h"
#include "ros/urdf_loader.h"
#include "ros/verify_service.h"
#include "sim/stepper.h"

namespace constraint_sim {
namespace {

constexpr unsigned kEditThreads = 4;
constexpr unsigned kQueryThreads = 2;
// Each of these services keeps a thread free to cancel, or to reject the next caller.
constexpr unsigned kVerifyThreads = 2;
constexpr unsigned kStepThreads = Stepper::kMostWaiting + 1;

StepperOptions stepper_options(const Parameters& parameters) {
  StepperOptions options;
  options.real_time_factor = parameters.real_time_factor;
  options.paused = parameters.paused;
  options.keeps_world_before_ticks = !parameters.plugins.empty();
  options.follows_clock = parameters.follows_clock();
  if (options.follows_clock)
    options.max_catch_up = EventLog::kClockJump;  // /clock may advance in large steps
  return options;
}

}  // namespace

class SimulatorNode::Impl {
 public:
  Impl(const ros::NodeHandle& handle, const ros::NodeHandle& private_handle);
  ~Impl();
  Impl(const Impl&) = delete;
  Impl& operator=(const Impl&) = delete;

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
  TrajectoryActions actions_;
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

SimulatorNode::Impl::Impl(const ros::NodeHandle& handle, const ros::NodeHandle& private_handle)
    : edits_(kEditThreads),
      queries_(kQueryThreads),
      steps_(kStepThreads),
      pauses_(1),
      verifications_(kVerifyThreads),
      clocks_(1),
      handle_(queries_.serving(handle)),
      private_handle_(queries_.serving(private_handle)),
      parameters_(read_parameters(private_handle_)),
      plugins_(parameters_, private_handle_),
      log_(parameters_),
      edit_log_(private_handle_),
      hands_(parameters_, private_handle_),
      robots_(parameters_),
      actions_(parameters_, edits_.serving(private_handle_)),
      publishers_(parameters_, robots_, actions_, handle_, private_handle_, hands_),
      event_topic_(private_handle_, publishers_),
      diagnostics_(parameters_, handle_, private_handle_.getNamespace()),
      stepper_(first_world(), stepper_options(parameters_), clock(), events()),
      services_(stepper_, edit_log_, publishers_, robots_, parameters_, service_handles()),
      verify_service_(stepper_, verifications_.serving(private_handle_)),
#ifdef CONSTRAINT_SIM_DYNAMIC_RECONFIGURE
      reconfigure_(edits_.serving(private_handle_), first_options_, pacing(),
                   [this](SetOptionsRequest& request) { return services_.set_options(request); }),
#endif
      urdf_loader_(stepper_, parameters_, robots_, edits_.serving(private_handle_)),
      commands_(stepper_, edit_log_, parameters_, robots_, actions_,
                edits_.serving(private_handle_)),
      follower_(parameters_),
      stepping_thread_(&Stepper::run, &stepper_) {
  hands_.start(&stepper_);
  follower_.start(handle_);
  tell_of_start(first_summary_);
  if (parameters_.follows_clock()) {
    ros::NodeHandle clock_handle = clocks_.serving(handle_);
    clock_topic_ = guarded_subscribe<rosgraph_msgs::Clock>(
        clock_handle, clock_guard_, 100,
        [this](const rosgraph_msgs::Clock& message) { on_clock(message); });
    clocks_.start();
  }
  for (ServiceQueue* queue : {&edits_, &queries_, &steps_, &pauses_, &verifications_})
    queue->start();
}

SimulatorNode::Impl::~Impl() {
  verify_service_.stop();
  stepper_.stop();  // answers all waiting callers, so that the queues can end
  stepping_thread_.join();
  hands_.stop();
  // Queues stop in parallel: the threads of each poll every 0.1 s.
  std::vector<std::future<void>> stopping;
  for (ServiceQueue* queue : {&edits_, &queries_, &steps_, &pauses_, &verifications_, &clocks_})
    stopping.push_back(std::async(std::launch::async, [queue] { queue->stop(); }));
}

World SimulatorNode::Impl::first_world() {
  try {
    World world = load_world(parameters_.scene, "", parameters_, Caller::kParameter);
    add_first_robot(handle_, private_handle_, parameters_, &robots_, &world);
    log_.edited(world);
    first_summary_ = summary(world);
    first_options_ = world.options();
    return world;
  } catch (const ParameterError&) {
    throw;
  } catch (const std::invalid_argument& error) {
    const std::string text = error.what();
    const bool is_tick = text.compare(0, 10, "time_step:") == 0;  // an error of the world's options
    throw ParameterError(is_tick ? "time_step" : "scene", text);
  }
}

// Logs the start, and settings that a user may not expect. The first line also makes roscpp set up
// the log now: set up only when the master shuts this node down for a second node of its name, the
// log would end both.
void SimulatorNode::Impl::tell_of_start(const std::string& world) {
  ROS_INFO("%s: %s%s", has_scene(parameters_.scene) ? parameters_.scene.c_str() : "no scene",
           world.c_str(), parameters_.paused ? "; paused" : "");
  if (parameters_.follows_clock())
    ROS_INFO("the world follows /clock, since /use_sim_time is true and publish_clock is false");
  for (const std::string& sentence : unknown_parameters(private_handle_))
    ROS_WARN("%s", sentence.c_str());
}

ServiceHandles SimulatorNode::Impl::service_handles() {
  return {edits_.serving(private_handle_), queries_.serving(private_handle_),
          steps_.serving(private_handle_), pauses_.serving(private_handle_)};
}

Stepper::Clock SimulatorNode::Impl::clock() const {
  if (parameters_.follows_clock()) return [this] { return clock_.load(); };
  return [] { return ros::SteadyTime::now().toSec(); };
}

Pacing SimulatorNode::Impl::pacing() const {
  return {stepper_.real_time_factor(), publishers_.publish_rate()};
}

// Notes a clock message. The log comes first: it explains ticks that the stepper drops after a
// jump.
void SimulatorNode::Impl::on_clock(const rosgraph_msgs::Clock& message) {
  const double clock = message.clock.toSec();
  log_.heard_clock(clock_, clock);
  clock_ = clock;
  stepper_.wake();
}

// Sets the world's time. The world keeps its time where the new one has no next tick.
void SimulatorNode::Impl::move_time(World* world, double time) {
  (*clock_guard_)([&] { world->set_time(time, world->step_count()); });
}

StepperEvents SimulatorNode::Impl::events() {
  StepperEvents events;
  events.stepping = [this](World& world) {
    edit_log_.drive(&world, [&](Driver* driver) {
      commands_.before_step(driver);
      follow_guard_([&] { follower_.before_step(driver, stepper_.real_time_factor()); });
    });
  };
  events.time_moved = [this](World& world, double time) { move_time(&world, time); };
  events.interrupted = [this](const World& world, const std::string& by) {
    commands_.end(by);
    robots_.tell_of_gone(world, by);
  };
  events.stepped = [this](const World& world, double seconds) {
    publishers_.stepped(world, seconds);
    event_topic_.stepped(world);
    diagnostics_.stepped(world, seconds);
    log_.stepped(world);
    edit_log_.stepped(world);
    if (!plugins_.empty()) plugins_.stepped(world, publishers_.stamp(world));
    if (commands_.has_goals()) commands_.stepped(world, publishers_.stamp(world));
    if (world.report().outcome.failed) commands_.end("a step that failed");
  };
  events.edited = [this](const World& world) {
#ifdef CONSTRAINT_SIM_DYNAMIC_RECONFIGURE
    reconfigure_.edited(world.options(), pacing());
#endif
    publishers_.edited(world);
    event_topic_.edited(world);
    hands_.edited(world);
    commands_.edited(world);
    log_.edited(world);
    edit_log_.edited(stepper_, world);
  };
  events.passed = [this](const World& world) {
    log_.passed(world, stepper_);
    edit_log_.passed(world);
    event_topic_.passed(world, stepper_);
    stepper_.time_stages(publishers_.wants_stage_times());
    const double again = std::min(diagnostics_.passed(world, stepper_, follower_), hands_.passed());
    return std::min(again, publishers_.passed(world, stepper_));
  };
  return events;
}

SimulatorNode::SimulatorNode(const ros::NodeHandle& handle, const ros::NodeHandle& private_handle)
    : impl_(std::make_unique<Impl>(handle, private_handle)) {}

SimulatorNode::~SimulatorNode() = default;

const Parameters& SimulatorNode::parameters() const { return impl_->parameters(); }

}  // namespace constraint_sim
