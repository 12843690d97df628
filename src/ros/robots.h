#pragma once

#include <ros/time.h>
#include <tf2_msgs/TFMessage.h>

#include <map>
#include <mutex>
#include <string>
#include <vector>

#include "ros/marker_set.h"
#include "ros/parameters.h"
#include "urdf/robot.h"

namespace constraint_sim {

/// The robots that were added from URDFs: the frames of their links, what they look like, and what
/// bounds their joints. A body that is gone is shown no longer. On any thread.
class Robots {
 public:
  explicit Robots(const Parameters& parameters) : parameters_(parameters) {}

  void add(const Robot& robot);
  /// Whether the body belongs to one.
  bool have(engine::BodyId body) const;

  /// Of a body that belongs to a robot the frames of its links, as `publish_links` and
  /// `publish_com` say. Of another body nothing, and false.
  bool add_frames(const engine::World& world, engine::BodyId body, const ros::Time& stamp,
                  tf2_msgs::TFMessage* message) const;
  /// What the robots look like of a world with these bodies: all where `is_edited`, else what has
  /// moved. A robot may have come since that world was copied; what has gone is shown no longer.
  void add_markers(const engine::World& world, const std::vector<engine::BodyId>& bodies,
                   bool is_edited, MarkerSet::Namespace* markers);
  /// The link with this name of a robot that is there.
  std::optional<RobotLink> find_link(const engine::World& world, const std::string& name) const;
  /// Of a joint with this name; none of one that no URDF bounds.
  JointBounds bounds(const std::string& joint) const;

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
    std::vector<Link> links;
    std::vector<Visual> visuals;
  };

  Parameters parameters_;
  mutable std::mutex mutex_;
  std::map<std::uint32_t, BodyLinks> bodies_;  // by their ids
  std::map<std::string, JointBounds> bounds_;
  std::int32_t last_marker_ = 0;
};

}  // namespace constraint_sim
