#pragma once

#include <constraint_sim/BodyStates.h>
#include <constraint_sim/ConstraintStates.h>
#include <constraint_sim/Statistics.h>
#include <ros/callback_queue.h>
#include <ros/node_handle.h>
#include <ros/subscriber.h>
#include <std_msgs/String.h>

#include <condition_variable>
#include <mutex>
#include <string>
#include <thread>
#include <vector>

namespace constraint_sim::panel {

/// Messages of one node. Subscribing and reading happen on a thread of its own; of states only the
/// latest message of each interval is read, so that a large world at a high rate costs little.
class Topics {
 public:
  struct Wanted {
    bool bodies = false;
    bool constraints = false;
    bool statistics = false;
    bool scenes = false;
  };
  /// What came since the last one was taken; null, empty or false: nothing.
  struct News {
    BodyStatesConstPtr bodies;
    ConstraintStatesConstPtr constraints;
    std::vector<StatisticsConstPtr> statistics;
    bool is_scene_new = false;  ///< another one was loaded than at first
  };

  explicit Topics(const std::string& node);
  ~Topics();
  Topics(const Topics&) = delete;
  Topics& operator=(const Topics&) = delete;

  /// What is to be subscribed to from now on.
  void want(const Wanted& wanted);
  News take();

 private:
  void run();
  void subscribe(const Wanted& wanted);
  void on_bodies(const BodyStatesConstPtr& message);
  void on_constraints(const ConstraintStatesConstPtr& message);
  void on_statistics(const StatisticsConstPtr& message);
  void on_scene(const std_msgs::StringConstPtr& message);

  std::mutex mutex_;  // of the next four
  std::condition_variable wake_up_;
  bool stopping_ = false;
  Wanted wanted_;
  News news_;

  // of the thread
  std::string node_;
  ros::CallbackQueue queue_;
  ros::NodeHandle handle_;
  ros::Subscriber bodies_, constraints_, statistics_, scenes_;
  bool has_scene_ = false;  // since it subscribes
  std::thread thread_;
};

}  // namespace constraint_sim::panel
