#pragma once

#include <geometry_msgs/Transform.h>
#include <ros/node_handle.h>
#include <ros/subscriber.h>
#include <tf2/buffer_core.h>
#include <tf2_msgs/TFMessage.h>

#include <mutex>
#include <optional>
#include <string>

#include "ros/guarded.h"
#include "ros/service_queue.h"

namespace constraint_sim {

/// Transforms of /tf and /tf_static, received since start() and kept for 10 s. Any thread.
class Frames {
 public:
  explicit Frames(const ros::NodeHandle& handle);

  /// Subscribes on the first call. Transforms arrive some time later.
  void start();
  /// Returns the pose of `source` in `target`; stamp 0: the latest. None where the frames are not
  /// connected at that time, or form a loop.
  std::optional<geometry_msgs::Transform> look_up(const std::string& target,
                                                  const std::string& source,
                                                  const ros::Time& stamp) const;

 private:
  ros::Subscriber listen(const std::string& topic, bool is_static);
  void take(const tf2_msgs::TFMessage& message, bool is_static, Guard* guard);

  tf2::BufferCore buffer_;
  ros::Time last_taken_;  // time of the last message on /tf, to notice that time has gone back
  ServiceQueue queue_{1};
  ros::NodeHandle handle_;
  std::once_flag started_;
  ros::Subscriber transforms_, static_transforms_;
};

}  // namespace constraint_sim
