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

/// Markers for rviz, with the ids of the world, in fixed namespaces: `bodies`; `parts` where a
/// body has further shapes; `constraints` (rods as cylinders; ropes striped, sagging while slack;
/// coils, struts, arms); `joints`, the turning or sliding part; `motors` as arrows; `contacts` and
/// `friction`, one marker each; `fixed`, cubes where lengths end at the world; `visuals` of robots.
/// A constraint that breaks is grey, in two parts, for two seconds.
class Markers {
 public:
  Markers(const std::string& frame, Robots& robots) : set_(frame), robots_(robots) {}

  /// Returns the message that brings subscribers up to date: moved, new and removed markers, and
  /// all of them once a second and for a new subscriber. Settings of bodies and constraints are
  /// read where `is_edited`, and with each complete message.
  const MarkerMessage& update(const engine::World& world, const ForceScale& forces,
                              const ros::Time& stamp, bool for_newcomer, bool is_edited);
  /// Makes the next message complete, since no subscriber has seen the last ones.
  void forget() { set_.forget(); }

 private:
  /// Properties of a constraint that change only with edits.
  struct JointLook {
    engine::JointId id;
    Look look = Look::kJoint;
    bool is_grip = false;
    bool is_drawn = false;
    bool has_motor = false;
    bool has_arm = false;  ///< a length with an anchor away from the centre of its body
    bool touches = false;  ///< a gear whose wheels touch and show the coupling
    double arm = 0.0;      ///< longest distance from a body's centre to its anchor [m]
    JointSize size;
    std::optional<engine::JointId> pulley;  ///< pulley whose rope this length is a part of
    double tackle = 1.0;  ///< factor from the pulley's force to the force in this length
  };
  /// Properties of a convex shape of a body that change only with edits.
  struct BodyLook {
    engine::BodyId id;
    bool has_shape_pose = false;
    std::size_t part = 0;  ///< number of the shape in its body
    std::int32_t marker =
        0;  ///< id in `bodies`, or in `parts` for the second part and further ones
  };
  /// Present state of a constraint.
  struct Seen {
    std::int32_t number;
    const JointLook& look;
    const engine::Joint& joint;
    const engine::JointState& state;
    Eigen::Vector3d p_a, p_b;  ///< anchors [m]; unset for a coupling
    double load;               ///< share of the largest force
  };

  void find_looks(const engine::World& world);
  JointLook& coupled_look(engine::JointId id);
  void find_extent(const engine::World& world);
  void add_body(const engine::World& world, const BodyLook& look);
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
  MarkerSet::Namespace& parts_ = set_.in("parts");
  MarkerSet::Namespace& constraints_ = set_.in("constraints");
  MarkerSet::Namespace& joints_ = set_.in("joints");
  MarkerSet::Namespace& motors_ = set_.in("motors");
  MarkerSet::Namespace& contacts_ = set_.in("contacts");
  MarkerSet::Namespace& friction_ = set_.in("friction");
  MarkerSet::Namespace& fixed_ = set_.in("fixed");
  MarkerSet::Namespace& hands_ = set_.in("hands");
  MarkerSet::Namespace& visuals_ = set_.in("visuals");
  Robots& robots_;
  const ForceScale* forces_ = nullptr;  // set while update() runs
  bool is_edited_ = true;               // since the last message
  std::vector<engine::BodyId> body_ids_;
  std::vector<BodyLook> body_looks_;  // movable bodies first
  std::size_t moving_ = 0;            // number of movable bodies
  std::vector<JointLook> joint_looks_;
  ShownMarker* cubes_ = nullptr;  // marker of `fixed`, where there is one
  Extent extent_;
  // Number of bodies, and id of the last body, when extent_ was measured.
  std::pair<std::size_t, std::int32_t> extent_of_;
  std::map<std::int32_t, double>
      broken_since_;  // stamp at which a constraint was seen to break [s], by id
};

}  // namespace constraint_sim
