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
#include <optional>
#include <string>
#include <thread>
#include <vector>

namespace constraint_sim::panel {

/// Messages of one node, on a thread of its own. Only the latest state of each interval is read, so
/// a large world at a high rate costs little.
class Topics {
 public:
  struct Wanted {
    bool bodies = false;
    bool constraints = false;
    bool statistics = false;
    bool scenes = false;
  };
  /// News since the last take(); null, empty or false: none.
  struct News {
    BodyStatesConstPtr bodies;
    ConstraintStatesConstPtr constraints;
    std::vector<StatisticsConstPtr> statistics;
    std::optional<std::string> scene;  ///< name of the scene; empty where it has none
    bool is_scene_new = false;         ///< another scene was loaded
  };

  explicit Topics(const std::string& node);
  ~Topics();
  Topics(const Topics&) = delete;
  Topics& operator=(const Topics&) = delete;

  /// Sets the topics to subscribe to.
  void want(const Wanted& wanted);
  News take();

 private:
  void run();
  void subscribe(const Wanted& wanted);
  void on_bodies(const BodyStatesConstPtr& message);
  void on_constraints(const ConstraintStatesConstPtr& message);
  void on_statistics(const StatisticsConstPtr& message);
  void on_scene(const std_msgs::StringConstPtr& message);

  std::mutex mutex_;  // protects the next four members
  std::condition_variable wake_up_;
  bool stopping_ = false;
  Wanted wanted_;
  News news_;

  // used by the thread only
  std::string node_;
  ros::CallbackQueue queue_;
  ros::NodeHandle handle_;
  ros::Subscriber bodies_, constraints_, statistics_, scenes_;
  bool has_scene_ = false;  // a scene was received
  std::thread thread_;
};

}  // namespace constraint_sim::panel
