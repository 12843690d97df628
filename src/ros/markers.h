#pragma once

#include <ros/time.h>

#include <cstdint>
#include <map>
#include <string>
#include <utility>
#include <vector>

#include "constraint_sim/engine/world.h"
#include "ros/joint_signs.h"
#include "ros/marker_lines.h"
#include "ros/marker_set.h"
#include "ros/marker_style.h"
#include "ros/robots.h"

namespace constraint_sim {

/// What rviz draws, with the ids of the world, in fixed namespaces: `bodies`; `constraints` (rods
/// as cylinders; ropes striped, hanging through while slack; coils, struts, arms); `joints`, the
/// solid of what turns or slides where; `motors` as arrows; `contacts` and `friction`, each one
/// marker for all; `fixed`, cubes where lengths end at the world; `visuals` of robots. A constraint
/// that breaks is grey, in two parts, for two seconds.
class Markers {
 public:
  Markers(const std::string& frame, Robots& robots) : set_(frame), robots_(robots) {}

  /// The message that brings a listener from the last one to this world: what moves, what is new,
  /// what is gone, and everything once a second and for a newcomer. Settings of bodies and
  /// constraints are looked at where `is_edited`, and with each full message.
  const MarkerMessage& update(const engine::World& world, const ForceScale& forces,
                              const ros::Time& stamp, bool for_newcomer, bool is_edited);
  /// Nobody has seen the last messages: the next one has everything again.
  void forget() { set_.forget(); }

 private:
  /// Of a constraint, what changes only with an edit.
  struct JointLook {
    engine::JointId id;
    Look look = Look::kJoint;
    bool is_grip = false;
    bool is_drawn = false;
    bool has_motor = false;
    bool has_arm = false;  ///< a length, from the centre of a body to its anchor
    bool touches = false;  ///< a gear, whose wheels say what it couples
    double arm = 0.0;      ///< the longer one, from a body's centre to its anchor [m]
    JointSize size;
    std::optional<engine::JointId> pulley;  ///< whose rope this length is a part of
    double tackle = 1.0;                    ///< so many times its force
  };
  /// Of a body, the same.
  struct BodyLook {
    engine::BodyId id;
    bool has_shape_pose = false;
  };
  /// A constraint as it is now.
  struct Seen {
    std::int32_t number;
    const JointLook& look;
    const engine::Joint& joint;
    const engine::JointState& state;
    Eigen::Vector3d p_a, p_b;  ///< its anchors [m]; none of a coupling
    double load;               ///< share of the largest force
  };

  void find_looks(const engine::World& world);
  JointLook& coupled_look(engine::JointId id);
  void find_extent(const engine::World& world);
  void add_body(const engine::World& world, const BodyLook& look);
  void add_shape(const engine::World& world, engine::BodyId id, const engine::BodyState& at);
  void add_grip(const engine::World& world, engine::JointId id);
  void add_constraint(const engine::World& world, const JointLook& look, const ros::Time& stamp);
  bool is_drawn(const JointLook& look, bool is_broken, const ros::Time& stamp);
  void draw_parts(const Seen& seen, ShownMarker* marker) const;
  void draw_length(const engine::World& world, const Seen& seen, ShownMarker* marker) const;
  void draw_rope(const engine::World& world, const Seen& seen, double length,
                 ShownMarker* marker) const;
  void draw_arms(const engine::World& world, const Seen& seen, ShownMarker* marker) const;
  void draw_coupling(const engine::World& world, const Seen& seen, ShownMarker* marker) const;
  void add_motor(const engine::World& world, const Seen& seen, const ShownMotor& motor);
  void add_arms_of_length(const engine::World& world, const Seen& seen);
  void add_fixed(const engine::World& world);
  void add_contacts(const engine::World& world);

  MarkerSet set_;
  MarkerSet::Namespace& bodies_ = set_.in("bodies");
  MarkerSet::Namespace& constraints_ = set_.in("constraints");
  MarkerSet::Namespace& joints_ = set_.in("joints");
  MarkerSet::Namespace& motors_ = set_.in("motors");
  MarkerSet::Namespace& contacts_ = set_.in("contacts");
  MarkerSet::Namespace& friction_ = set_.in("friction");
  MarkerSet::Namespace& fixed_ = set_.in("fixed");
  MarkerSet::Namespace& hands_ = set_.in("hands");
  MarkerSet::Namespace& visuals_ = set_.in("visuals");
  Robots& robots_;
  const ForceScale* forces_ = nullptr;  // while update() runs
  bool is_edited_ = true;               // since the last message
  std::vector<engine::BodyId> body_ids_;
  std::vector<BodyLook> body_looks_;  // first of all what can move
  std::size_t moving_ = 0;            // so many
  std::vector<JointLook> joint_looks_;
  ShownMarker* cubes_ = nullptr;  // of `fixed`, where there are some
  Extent extent_;
  std::pair<std::size_t, std::int32_t> extent_of_;  // how many bodies, and the last one
  std::map<std::int32_t, double> broken_since_;     // stamps [s], of what was seen to break
};

}  // namespace constraint_sim
