#pragma once

#include <ros/time.h>

#include <cstdint>
#include <map>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include "constraint_sim/engine/world.h"
#include "ros/joint_signs.h"
#include "ros/marker_set.h"
#include "ros/marker_style.h"

namespace constraint_sim {

/// Texts beside the shapes that Markers draws, on a topic of their own since they cost more than
/// the shapes: `body_names`, `constraint_names`, `forces`, `motor_rates`, `limits`, `errors` of
/// constraints that are off, and a `legend` of the colours above the scene.
class Labels {
 public:
  /// Number of bodies, and of constraints, with labels: the first ones.
  static constexpr std::size_t kMost = 200;

  explicit Labels(const std::string& frame) : set_(frame) {}

  const MarkerMessage& update(const engine::World& world, const ForceScale& forces,
                              const ros::Time& stamp, bool for_newcomer);
  void forget();

 private:
  struct Line {
    const char* ns;
    std_msgs::ColorRGBA colour;
    std::string text;
  };
  /// Lines of text above the end of a length [m].
  struct Block {
    Eigen::Vector3d end;
    double half;  ///< half of the width [m]
    double low, high;
  };
  struct Told;

  void add_text(const char* ns, std::int32_t id, const Eigen::Vector3d& place,
                const std_msgs::ColorRGBA& colour, const std::string& text, double height = 0.0);
  JointSize size_in_gear(const engine::World& world, engine::JointId id) const;
  void find_all_wheels(const engine::World& world);
  std::vector<Line> lines_of(const engine::World& world, const ForceScale& forces,
                             engine::JointId id) const;
  void add_labels_of(const engine::World& world, const ForceScale& forces, engine::JointId id);
  Eigen::Vector3d free_place(const std::vector<Line>& lines, const Eigen::Vector3d& end);
  Told told(const engine::World& world, const ForceScale& forces) const;
  void add_legend(const engine::World& world, const ForceScale& forces);
  void find_broken(const engine::World& world, double now);
  bool shows_broken(engine::JointId id) const;
  double growth(const engine::World& world, const Extent& extent);

  MarkerSet set_;
  using Number = decltype(engine::JointId::value);
  std::optional<std::map<Number, double>>
      broke_;                   // time at which a constraint was seen to be broken [s], by id
  double now_ = 0.0;            // [s]
  std::optional<Extent> seen_;  // extent of the scene so far, and as extrapolated by kAhead
  std::map<Number, JointSize> wheels_;
  std::set<Number> touch_;  // ids of gears whose wheels touch
  std::vector<Block> blocks_;
  double top_ = 0.0;   // top of the labels of constraints [m]
  double cube_ = 0.0;  // half edge of cubes that mark ends at the world [m]
  double height_ = 0.0, height_of_legend_ = 0.0;  // heights of letters [m]
};

}  // namespace constraint_sim
