#pragma once

#include <constraint_sim/Statistics.h>
#include <geometry_msgs/TransformStamped.h>
#include <ros/node_handle.h>
#include <ros/publisher.h>
#include <tf2_msgs/TFMessage.h>

#include <atomic>
#include <condition_variable>
#include <cstdint>
#include <exception>
#include <mutex>
#include <string>
#include <thread>

#include "ros/hands.h"
#include "ros/labels.h"
#include "ros/markers.h"
#include "ros/odometry.h"
#include "ros/parameters.h"
#include "ros/plot_topics.h"
#include "ros/robot_topics.h"
#include "ros/robots.h"
#include "ros/trajectory_actions.h"
#include "ros/wrench_topics.h"
#include "sim/stamps.h"
#include "sim/statistics.h"
#include "sim/stepper.h"

namespace constraint_sim {

/// The node's topics. The stepping thread only copies the world when a publication is due and has
/// subscribers; a separate thread builds and sends messages.
class Publishers {
 public:
  Publishers(const Parameters& parameters, Robots& robots, TrajectoryActions& actions,
             ros::NodeHandle& handle, ros::NodeHandle& private_handle, Hands& hands);
  ~Publishers();
  Publishers(const Publishers&) = delete;
  Publishers& operator=(const Publishers&) = delete;

  // ---- stepping thread
  void stepped(const World& world, double seconds);
  void edited(const World& world);
  /// Hands the world to the publishing thread when due. Returns the time until the next call [s].
  /// Rethrows exceptions of the publishing thread.
  double passed(const World& world, const Stepper& stepper);
  void set_real_time_factor(double factor) { stamps_.set_real_time_factor(factor); }
  double publish_rate() const { return parameters_.publish_rate; }
  void set_publish_rate(double rate) {
    parameters_.publish_rate = rate;
    next_publication_ = 0.0;
  }
  /// Makes the next markers begin with DELETEALL. Any thread.
  void renew_markers() { renew_markers_ = true; }
  /// Returns the stamp of messages about this world, for use in a response.
  ros::Time stamp(const World& world) const;
  const std::string& world_frame() const { return parameters_.world_frame; }
  bool wants_stage_times() const { return statistics_topic_.getNumSubscribers() > 0; }

 private:
  /// Input of one round of messages.
  struct Snapshot {
    World world;
    ros::Time stamp;
    bool for_newcomer = false;
    bool renew_markers = false;
    bool plan_changed = false;
    bool has_statistics = false;
    Statistics statistics;
  };

  double next_due() const;
  bool anybody_listens() const;
  void publish_clock(const World& world, double now);
  void take_snapshot(const World& world, const Stepper& stepper, double now);
  void take_statistics(const World& world, const Stepper& stepper, double now, Statistics& message);

  void run();
  void publish(const Snapshot& snapshot);
  geometry_msgs::TransformStamped transform_of(const Snapshot& snapshot, engine::BodyId id) const;
  void publish_transforms(const Snapshot& snapshot);
  void publish_static_transforms(const Snapshot& snapshot);
  void publish_markers(const Snapshot& snapshot);
  void publish_body_states(const Snapshot& snapshot);
  void publish_constraint_states(const Snapshot& snapshot);
  void publish_contact_states(const Snapshot& snapshot);
  void publish_contact_forces(const Snapshot& snapshot);
  void publish_joint_states(const Snapshot& snapshot);
  void publish_plan(const Snapshot& snapshot);
  void publish_wrenches(const Snapshot& snapshot);

  Parameters parameters_;
  Robots& robots_;
  TrajectoryActions& actions_;
  Hands& hands_;
  ros::Publisher transforms_topic_;
  ros::Publisher static_transforms_topic_;
  ros::Publisher markers_topic_;
  ros::Publisher labels_topic_;
  ros::Publisher body_states_topic_;
  ros::Publisher constraint_states_topic_;
  ros::Publisher contact_states_topic_;
  ros::Publisher contact_forces_topic_;
  ros::Publisher joint_states_topic_;
  WrenchTopics wrench_topics_;
  RobotTopics robot_topics_;
  PlotTopics plot_topics_;
  Odometry odometry_;
  ros::Publisher statistics_topic_;
  ros::Publisher plan_topic_;
  ros::Publisher clock_topic_;

  // Stepping thread only; times are those of the steady clock [s].
  Stamps stamps_;
  TickStatistics ticks_;
  std::uint64_t dropped_ticks_ = 0;
  bool stepped_ = false;
  bool edited_ = true;
  bool plan_changed_ = true;
  std::size_t wrenches_ = 0;
  std::uint32_t asleep_ = 0;
  double next_publication_ = 0.0;
  double last_publication_ = 0.0;
  double last_statistics_;
  double last_clock_ = 0.0;
  double clock_time_ = 0.0;  // time in the last message on /clock [s]

  // shared by both threads
  std::atomic<bool> newcomer_{false};  // a new subscriber has connected
  std::atomic<bool> renew_markers_{false};
  std::mutex mutex_;
  std::condition_variable wake_up_;
  bool fresh_ = false;
  bool stopping_ = false;
  std::exception_ptr thrown_;  // thrown on the publishing thread
  std::atomic<bool> has_thrown_{false};
  Snapshot incoming_;

  // publishing thread only
  Snapshot current_;
  ForceScale forces_;
  Markers markers_;
  Labels labels_;
  double last_labels_ = 0.0;  // steady clock [s]
  tf2_msgs::TFMessage static_transforms_;
  std::string plan_;
  std::thread thread_;
};

}  // namespace constraint_sim
