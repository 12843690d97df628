#pragma once

#include <ros/callback_queue.h>
#include <ros/node_handle.h>
#include <ros/spinner.h>

namespace constraint_sim {

/// A callback queue with threads of its own.
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
  ros::CallbackQueue queue_;
  ros::AsyncSpinner spinner_;
};

}  // namespace constraint_sim
