#pragma once

#include <ros/time.h>

#include <cstdint>
#include <map>
#include <optional>
#include <string>

#include "constraint_sim/engine/world.h"
#include "ros/joint_signs.h"
#include "ros/marker_set.h"
#include "ros/marker_style.h"

namespace constraint_sim {

/// Texts beside what Markers draws, on a topic of their own, for they cost more than what they
/// name: `body_names`, `constraint_names`, `forces` [N], `motor_rates`, `errors` of constraints
/// that are off, and a `legend` of the colours above the scene.
class Labels {
 public:
  /// So many bodies and so many constraints, the first ones, have labels.
  static constexpr std::size_t kMost = 200;

  explicit Labels(const std::string& frame) : set_(frame) {}

  const MarkerMessage& update(const engine::World& world, const ForceScale& forces,
                              const ros::Time& stamp, bool for_newcomer);
  void forget();

 private:
  void add_text(const char* ns, std::int32_t id, const Eigen::Vector3d& place,
                const std_msgs::ColorRGBA& colour, const std::string& text, double height = 0.0);
  JointSize size_in_gear(const engine::World& world, engine::JointId id) const;
  void find_all_wheels(const engine::World& world);
  void add_labels_of(const engine::World& world, engine::JointId id);
  void add_legend(const engine::World& world, const ForceScale& forces, bool has_broken);
  bool is_any_broken_shown(const engine::World& world, double now);
  double growth(const engine::World& world, const Extent& extent);

  MarkerSet set_;
  std::optional<std::size_t> broken_;  // joints, at the last look
  std::optional<double> broke_;        // when there were more of them [s]
  std::optional<Extent> seen_;         // where the scene was, and will be in a second as it moves
  std::map<decltype(engine::JointId::value), JointSize> wheels_;
  double height_ = 0.0, height_of_legend_ = 0.0;  // of letters [m]
};

}  // namespace constraint_sim
