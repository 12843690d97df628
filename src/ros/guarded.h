#pragma once

#include <ros/advertise_service_options.h>
#include <ros/console.h>
#include <ros/node_handle.h>
#include <ros/steady_timer.h>
#include <ros/subscriber.h>
#include <ros/time.h>

#include <atomic>
#include <boost/function.hpp>
#include <boost/make_shared.hpp>
#include <boost/shared_ptr.hpp>
#include <cstdint>
#include <functional>
#include <memory>
#include <string>
#include <utility>

#include "ros/poll_pause.h"
#include "ros/received.h"
#include "sim/errors.h"
#include "sim/stepper.h"

namespace constraint_sim {

/// The border where one input enters the node: a topic, a service, a callback or a call of a
/// plugin. An exception of any type drops that input and becomes a warning in the log, at most one
/// per second of wall time, since simulated time may stand still. Any thread.
class Guard {
 public:
  /// `input`: name of the topic or callback, with which each warning begins.
  explicit Guard(std::string input) : input_(std::move(input)) {}

  /// Calls `act`; returns whether it ended without an exception.
  template <class Act>
  bool operator()(Act&& act) noexcept {
    try {
      act();
      return true;
    } catch (const Cancelled&) {  // the node is shutting down
    } catch (...) {
      warn(message_of_exception());
    }
    return false;
  }

  void warn(const std::string& why) {
    const double now = ros::SteadyTime::now().toSec();
    double before = warned_;
    if (now < before + 1.0 || !warned_.compare_exchange_strong(before, now)) return;
    ROS_WARN("%s: %s", input_.c_str(), why.c_str());
  }

  const std::string& input() const { return input_; }

 private:
  std::string input_;
  std::atomic<double> warned_{-1e9};  // steady clock [s]
};

using SharedGuard = std::shared_ptr<Guard>;

inline SharedGuard make_guard(std::string input) {
  return std::make_shared<Guard>(std::move(input));
}

/// Calls `act` behind a guard that exists for this call only: for inputs that are rare.
template <class Act>
bool guarded(const std::string& input, Act&& act) noexcept {
  return Guard(input)(std::forward<Act>(act));
}

/// Queues `change` for the stepping thread without waiting. The guard also holds when the change
/// runs; a change that throws must have changed nothing.
inline void guarded_post(Stepper& stepper, const SharedGuard& guard,
                         std::function<void(World&)> change) noexcept {
  (*guard)([&] {
    stepper.post(
        [guard, change = std::move(change)](World& world) { (*guard)([&] { change(world); }); });
  });
}

/// Subscribes to the topic that the guard is named after; the only subscription function of
/// src/ros. `handle_message` receives a const Message& that a BoundedStream has read.
template <class Message, class HandleMessage>
ros::Subscriber guarded_subscribe(ros::NodeHandle& handle, const SharedGuard& guard,
                                  std::uint32_t queue, HandleMessage handle_message) {
  using Pointer = boost::shared_ptr<const Received<Message>>;
  return handle.subscribe<Received<Message>>(
      guard->input(), queue,
      boost::function<void(const Pointer&)>([guard, handle_message](const Pointer& received) {
        (*guard)([&] { handle_message(received->message); });
      }));
}

/// Advertises a service; the only advertising function of src/ros. `serve` receives request and
/// response, and returns whether the call succeeded. The call also fails where `serve` throws. A
/// BoundedStream reads the request, and a PollPause is held while the response is written.
template <class Request, class Response, class Serve>
ros::ServiceServer guarded_service(ros::NodeHandle& handle, const std::string& name, Serve serve) {
  using Spec = ros::ServiceSpec<Received<Request>, Response>;
  const typename Spec::CallbackType call = [guard = make_guard(name), serve](
                                               Received<Request>& received, Response& response) {
    bool is_served = false;
    return (*guard)([&] { is_served = serve(received.message, response); }) && is_served;
  };
  ros::AdvertiseServiceOptions options;
  options.initBySpecType<Spec>(name, call);
  options.helper = boost::make_shared<PausingCalls<Spec>>(call);
  return handle.advertiseService(options);
}

/// Calls `act` again and again; the only timer of src/ros. It goes by the steady clock, since
/// simulated time may stand still.
template <class Act>
ros::SteadyTimer guarded_timer(ros::NodeHandle& handle, const SharedGuard& guard, double period,
                               Act act) {
  return handle.createSteadyTimer(
      ros::WallDuration(period),
      [guard, act](const ros::SteadyTimerEvent&) { (*guard)([&] { act(); }); });
}

/// Advertises a service that a member function serves.
template <class Owner, class Request, class Response>
ros::ServiceServer guarded_service(ros::NodeHandle& handle, const std::string& name,
                                   bool (Owner::*serve)(Request&, Response&), Owner* owner) {
  return guarded_service<Request, Response>(handle, name,
                                            [owner, serve](Request& request, Response& response) {
                                              return (owner->*serve)(request, response);
                                            });
}

}  // namespace constraint_sim
