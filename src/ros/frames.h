#pragma once

#include <geometry_msgs/Transform.h>
#include <ros/node_handle.h>
#include <ros/subscriber.h>
#include <tf2/buffer_core.h>
#include <tf2_msgs/TFMessage.h>

#include <memory>
#include <mutex>
#include <optional>
#include <string>

#include "ros/guarded.h"
#include "ros/service_queue.h"

namespace constraint_sim {

/// Transforms of /tf and /tf_static, received since start() and kept for 10 s. Any thread.
class Frames {
 public:
  Frames();

  /// Subscribes on the first call. Transforms arrive some time later.
  void start(const ros::NodeHandle& handle);
  /// Stores the transforms of a message on /tf or /tf_static, and warns of rejected ones. One
  /// thread at a time.
  void take(const tf2_msgs::TFMessage& message, bool is_static, Guard* guard);
  /// Returns the pose of `source` in `target`; stamp 0: the latest. None where the frames are not
  /// connected at that time, or form a loop.
  std::optional<geometry_msgs::Transform> look_up(const std::string& target,
                                                  const std::string& source,
                                                  const ros::Time& stamp) const;

 private:
  ros::Subscriber listen(ros::NodeHandle handle, const std::string& topic, bool is_static);

  tf2::BufferCore buffer_;
  ros::Time last_taken_;  // time of the last message on /tf, to notice that time has gone back
  std::once_flag started_;
  std::unique_ptr<ServiceQueue> queue_;  // since start()
  ros::Subscriber transforms_, static_transforms_;
};

}  // namespace constraint_sim
