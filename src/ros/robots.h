#pragma once

#include <ros/time.h>
#include <tf2_msgs/TFMessage.h>

#include <atomic>
#include <cstddef>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include "ros/marker_set.h"
#include "ros/parameters.h"
#include "urdf/robot.h"

namespace constraint_sim {

/// Robot with its URDF as other programs read it: names of links have the prefixes of their frames,
/// names of joints the prefix of the constraints.
struct RobotDescription {
  std::string name;  ///< as in topics: the prefix, or the name in the URDF where there is no prefix
  std::shared_ptr<const std::string> text;
  std::shared_ptr<const std::set<std::string>> joints;  ///< names of the joints
  /// Positions of joints that are fixed since they move no mass [m or rad].
  std::shared_ptr<const std::map<std::string, double>> fixed_joints;
};

/// A URDF, and the absolute path of its folder; empty where it has none.
struct UrdfText {
  std::string text, folder;
};

/// Robots added from URDFs: frames of links, visuals, and bounds of joints; and the meshes of other
/// bodies. Bodies and joints are identified by id and name, since a snapshot of another process may
/// reuse ids. A removed robot is hidden until a snapshot restores it; the oldest removed ones are
/// forgotten beyond kMostBytes. Any thread.
class Robots {
 public:
  /// Size of the data of all bodies and joints, some hundred robots, beyond which removed robots
  /// are forgotten [bytes].
  static constexpr std::size_t kMostBytes = std::size_t{8} << 20;

  explicit Robots(const Parameters& parameters) : parameters_(parameters) {}

  /// Adds a robot that has just been added to `world` from this URDF with this prefix.
  void add(const Robot& robot, const UrdfText& urdf, const std::string& prefix,
           const engine::World& world);
  /// Adds visuals of bodies that belong to no robot.
  void add(const std::vector<RobotVisual>& visuals, const engine::World& world);
  /// Returns the robots in `world`, each name once.
  std::vector<RobotDescription> descriptions(const engine::World& world) const;
  /// Returns whether the body belongs to a robot.
  bool have(const engine::World& world, engine::BodyId body) const;
  /// Logs the links that are hidden since `by` replaced the world.
  void tell_of_gone(const engine::World& world, const std::string& by);

  /// Adds the frames of a body's links, as `publish_links` and `publish_com` say. Returns false for
  /// a body without a robot.
  bool add_frames(const engine::World& world, engine::BodyId body, const ros::Time& stamp,
                  tf2_msgs::TFMessage* message) const;
  /// Adds the visuals of all robots where `is_edited`, else only those that moved.
  void add_markers(const engine::World& world, bool is_edited, MarkerSet::Namespace* markers) const;
  /// Returns the link with this name of a robot in `world`.
  std::optional<RobotLink> find_link(const engine::World& world, const std::string& name) const;
  /// Returns the bounds of a joint; unbounded where no URDF sets them.
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
    visualization_msgs::Marker marker;  ///< mesh or shape, with colour and scale
  };
  struct BodyLinks {
    std::string body;         ///< name of the body
    bool is_of_robot = true;  ///< false: the body only has visuals
    std::vector<Link> links;
    std::vector<Visual> visuals;
    bool is_gone = false;                   ///< state at the last log line
    std::optional<RobotDescription> robot;  ///< the robot whose root this body is
  };
  struct BoundedJoint {
    std::string name;
    JointBounds bounds;
  };

  const BodyLinks* find(const engine::World& world, engine::BodyId body) const;
  Visual make_visual(const RobotVisual& of);
  void forget_oldest(const engine::World& world);
  static std::size_t size_of(const BodyLinks& links);
  static std::size_t size_of(const BoundedJoint& joint);

  Parameters parameters_;
  mutable std::mutex mutex_;
  std::atomic<bool> has_any_{false};
  std::map<std::uint32_t, BodyLinks> bodies_;  // by body id
  std::map<std::uint32_t, BoundedJoint> bounds_;
  std::int32_t last_marker_ = 0;
};

}  // namespace constraint_sim
