#pragma once

#include <ros/callback_queue.h>
#include <ros/node_handle.h>
#include <ros/spinner.h>

#include <boost/make_shared.hpp>
#include <cstdint>
#include <memory>
#include <utility>

#include "ros/poll_pause.h"

namespace constraint_sim {

/// A callback queue with threads of its own. Each callback may hold the poll thread while its
/// response is written (PollPause).
class ServiceQueue {
 public:
  explicit ServiceQueue(unsigned threads) : spinner_(threads, &queue_) {}

  /// Returns the handle with this queue.
  ros::NodeHandle serving(ros::NodeHandle handle) {
    handle.setCallbackQueue(&queue_);
    return handle;
  }
  void start() { spinner_.start(); }
  /// Returns when all received calls are answered.
  void stop() {
    spinner_.stop();
    queue_.callAvailable();
  }

 private:
  struct Answering : ros::CallbackInterface {
    Answering(ros::CallbackInterfacePtr callback, PollPause* pause)
        : callback(std::move(callback)), pause(pause) {}
    CallResult call() override {
      const PollPause::Answer answer(pause);
      return callback->call();
    }
    bool ready() override { return callback->ready(); }

    const ros::CallbackInterfacePtr callback;
    PollPause* const pause;
  };

  struct Queue : ros::CallbackQueue {
    void addCallback(const ros::CallbackInterfacePtr& callback, std::uint64_t id) override {
      CallbackQueue::addCallback(boost::make_shared<Answering>(callback, pause.get()), id);
    }
    const std::shared_ptr<PollPause> pause = PollPause::shared();
  };

  Queue queue_;
  ros::AsyncSpinner spinner_;
};

}  // namespace constraint_sim
