#pragma once

#include <ros/time.h>
#include <tf2_msgs/TFMessage.h>

#include <atomic>
#include <cstddef>
#include <map>
#include <mutex>
#include <string>
#include <vector>

#include "ros/marker_set.h"
#include "ros/parameters.h"
#include "urdf/robot.h"

namespace constraint_sim {

/// The robots that were added from URDFs: the frames of their links, what they look like, and what
/// bounds their joints. Bodies and joints are known by id and name, since those of a snapshot of
/// another process may have the ids of others here. A robot that is gone is shown no longer, until
/// a snapshot brings it back; of these the oldest are forgotten beyond kMostBytes. On any thread.
class Robots {
 public:
  /// [bytes] of what is known of all bodies and joints, beyond which those that are gone are
  /// forgotten: some hundred robots.
  static constexpr std::size_t kMostBytes = std::size_t{8} << 20;

  explicit Robots(const Parameters& parameters) : parameters_(parameters) {}

  /// One that has just been added to this world.
  void add(const Robot& robot, const engine::World& world);
  /// Whether the body belongs to one.
  bool have(const engine::World& world, engine::BodyId body) const;
  /// Names in the log the links that are shown no longer since `by` replaced the world.
  void tell_of_gone(const engine::World& world, const std::string& by);

  /// Of a body that belongs to a robot the frames of its links, as `publish_links` and
  /// `publish_com` say. Of another body nothing, and false.
  bool add_frames(const engine::World& world, engine::BodyId body, const ros::Time& stamp,
                  tf2_msgs::TFMessage* message) const;
  /// What the robots of a world look like: all where `is_edited`, else what has moved.
  void add_markers(const engine::World& world, bool is_edited, MarkerSet::Namespace* markers) const;
  /// The link with this name of a robot that is there.
  std::optional<RobotLink> find_link(const engine::World& world, const std::string& name) const;
  /// Of a joint; none of one that no URDF bounds.
  JointBounds bounds(const engine::World& world, engine::JointId joint) const;

 private:
  struct Link {
    std::string frame;
    Eigen::Isometry3d in_body;
    bool is_root;
  };
  struct Visual {
    std::int32_t id;
    Eigen::Vector3d position;  ///< in the body's frame [m]
    Eigen::Quaterniond orientation;
    visualization_msgs::Marker marker;  ///< what it looks like
  };
  struct BodyLinks {
    std::string body;  ///< its name
    std::vector<Link> links;
    std::vector<Visual> visuals;
    bool is_gone = false;  ///< as was told last
  };
  struct BoundedJoint {
    std::string name;
    JointBounds bounds;
  };

  const BodyLinks* find(const engine::World& world, engine::BodyId body) const;
  void forget_oldest(const engine::World& world);
  static std::size_t size_of(const BodyLinks& links);
  static std::size_t size_of(const BoundedJoint& joint);

  Parameters parameters_;
  mutable std::mutex mutex_;
  std::atomic<bool> has_any_{false};
  std::map<std::uint32_t, BodyLinks> bodies_;  // by their ids
  std::map<std::uint32_t, BoundedJoint> bounds_;
  std::int32_t last_marker_ = 0;
};

}  // namespace constraint_sim
