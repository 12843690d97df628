#pragma once

#include <ros/time.h>
#include <std_msgs/ColorRGBA.h>
#include <visualization_msgs/Marker.h>

#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "constraint_sim/engine/world.h"

namespace constraint_sim {

/// Shape by which a constraint is drawn. Distance joints have several.
enum class Look { kRod, kRope, kStrut, kSpring, kJoint, kCoupling };
Look look_of(const engine::Joint& joint);
/// Returns whether the joint is a rope that may go slack: a distance joint or a pulley.
bool is_rope(const engine::Joint& joint);
/// Returns whether a rope hangs slack and transmits no force.
bool is_slack(const engine::Joint& joint, const engine::JointState& state);
/// Returns the error of a joint that is closing [m]: 0 where a motor on its way to a position is
/// the cause.
double error_while_closing(const engine::Joint& joint, const engine::JointState& state);
/// Returns the error to show [m]: 0 for a spring or a rope with stiffness, whose length is free,
/// and for a motor on its way to a position.
inline double shown_error(Look look, const engine::Joint& joint, const engine::JointState& state) {
  if (look == Look::kSpring || joint.distance.one_sided) return 0.0;
  return state.closing ? error_while_closing(joint, state) : std::abs(state.error);
}
/// Returns the force along the drawn line [N], > 0 in compression; none for shapes without a line.
std::optional<double> axial_force(const engine::Joint& joint, const engine::JointState& state);

/// A motor that drives a coordinate along or about the axis of its joint, or a distance.
struct ShownMotor {
  bool is_angle = false;  ///< turns about the axis; else moves along it
  double rate = 0.0;      ///< target rate [m/s or rad/s]
  double force = 0.0;     ///< force of a force-controlled motor, which has no rate [N or N m]
  double direction() const { return rate != 0.0 ? rate : force; }
};
std::optional<ShownMotor> shown_motor(const engine::Joint& joint, const engine::JointState& state);

inline constexpr double kNoForce = 1e-9;  ///< smaller forces are rounding, over the largest force
inline constexpr double kLeastLoad =
    1e-3;  ///< smaller loads are shown as none, over the largest force
inline constexpr double kLeastFriction =
    0.02;  ///< smaller friction is not drawn, over the largest contact force
inline constexpr double kFixedCube =
    2.5;  ///< edge of cubes that mark ends at the world, over the width of lines
inline constexpr double kBrokenShown = 2.0;  ///< [s]
inline constexpr double kToldError = 1e-4;   ///< error at which constraints begin to turn red [m]
inline constexpr double kRedError = 1e-2;    ///< error from which constraints are red [m]

/// Radius about the centre of mass [m]; 0 for points and planes.
double radius_of(const engine::Shape& shape);

/// Half the extent of a shape along a direction (unit) in its own frame [m]; of a compound to the
/// farther side of its body.
double half_width(const engine::Shape& shape, const Eigen::Vector3d& along);
/// Returns the pose of a convex shape in the frame of its body, by the number of the part.
engine::ShapePose pose_of_part(const engine::Body& body, std::size_t part);
/// Middle of a body's shape in the world's frame, and half of its extent along a direction [m].
Eigen::Vector3d middle_of(const engine::Body& body, const engine::BodyState& state);
double half_width(const engine::Body& body, const engine::BodyState& state,
                  const Eigen::Vector3d& along);

/// Returns whether a constraint is drawn as a line between anchors: rods, ropes, springs and
/// struts.
bool is_length(Look look);
/// Returns whether one end of a length is at the world, where a cube marks it.
bool is_on_world(const engine::Joint& joint);
/// Returns whether an anchor lies outside the body's shape, which would hide the arm to it.
bool has_arm_outside(const engine::World& world, const engine::Joint& joint);

/// Sets type and size of a body's marker. A plane is a sheet, half as opaque.
void set_shape(visualization_msgs::Marker* marker, const engine::Shape& shape);

inline std_msgs::ColorRGBA colour(double r, double g, double b, double a = 1.0) {
  std_msgs::ColorRGBA msg;
  msg.r = static_cast<float>(r);
  msg.g = static_cast<float>(g);
  msg.b = static_cast<float>(b);
  msg.a = static_cast<float>(a);
  return msg;
}
std_msgs::ColorRGBA body_colour(const engine::Body& body);
/// Colour of a constraint: green without load, cyan in tension, yellow in compression, by the share
/// of the largest force; then towards red by the logarithm of the error [m].
std_msgs::ColorRGBA constraint_colour(double share, double error);
std_msgs::ColorRGBA motor_colour(bool saturated);
std_msgs::ColorRGBA friction_colour(bool sticks);
std_msgs::ColorRGBA slack_colour();
std_msgs::ColorRGBA broken_colour();
std_msgs::ColorRGBA fixed_colour();

/// Friction on body A along the surface [N].
inline Eigen::Vector3d friction_of(const engine::Contact& contact) {
  return contact.force - contact.normal_force * contact.normal;
}

/// Friction shown by one arrow: of one slipping contact, or the sum over the sticking contacts of
/// two bodies, since only the sum is determined.
struct ShownFriction {
  const engine::Contact *first,
      *end;               ///< contacts of the pair; slipping ones have arrows of their own
  Eigen::Vector3d force;  ///< on A [N]
  bool sticks;
};

/// Calls `show` for each arrow of friction. Contacts of a pair of bodies follow each other.
template <class Show>
void for_each_friction(const std::vector<engine::Contact>& contacts, Show show) {
  const engine::Contact* const all = contacts.data() + contacts.size();
  for (const engine::Contact *first = contacts.data(), *end = first; first != all; first = end) {
    Eigen::Vector3d held = Eigen::Vector3d::Zero();
    bool sticks = false;
    for (; end != all && end->body_a == first->body_a && end->body_b == first->body_b; ++end) {
      if (end->state == engine::ContactState::kClosed) continue;
      const Eigen::Vector3d force = friction_of(*end);
      if (end->state == engine::ContactState::kSticking) {
        held += force;
        sticks = true;
      } else {
        show(ShownFriction{end, end + 1, force, false});
      }
    }
    if (sticks) show(ShownFriction{first, end, held, true});
  }
}

/// Extent of a scene without planes, and the size of its arrows and lines.
struct Extent {
  Eigen::Vector3d low = Eigen::Vector3d::Zero(), high = Eigen::Vector3d::Zero();  ///< [m]
  double sign = 0.0;   ///< length of arrows [m]
  double width = 0.0;  ///< largest width of lines [m]
  double diagonal() const { return (high - low).norm(); }
};

/// Largest forces of the last seconds in distance joints and contacts, to which drawn forces are
/// scaled. Updated ten times a second, and at every call until there is a force.
class ForceScale {
 public:
  void update(const engine::World& world, const ros::Time& stamp);
  double reference() const { return axial_; }            ///< of distance joints [N]
  double contact_reference() const { return contact_; }  ///< of contacts [N]
  /// Visible length of the arrow of the reference force [m].
  double contact_reach(const Extent& extent) const {
    return contact_length(extent) - (is_on_ball_ ? 0.0 : thickness_);
  }
  /// Length of the arrow of the reference force [m]: it starts inside the held body and has to come
  /// out of it.
  double contact_length(const Extent& extent) const {
    constexpr double kOut = 1.3;
    return std::max(extent.sign, kOut * thickness_);
  }
  /// Returns a force over the reference, clamped to ±1.
  double share(double force) const;

 private:
  double axial_ = 0.0, contact_ = 0.0;
  double thickness_ =
      0.0;  // thickness, along the force, of the body under the largest contact force [m]
  bool is_on_ball_ = false;
  ros::Time stamp_;
};

/// Direction of gravity (unit).
Eigen::Vector3d down(const engine::World& world);

/// Returns the sign of the force on A for the force on the held body: the movable one, or the upper
/// one of two.
double sign_of_held(const engine::World& world, const engine::Contact& contact,
                    const Eigen::Vector3d& down);

/// Radius of a ball, else 0 [m]: an arrow starts at the far side of a ball, which would hide it.
double radius_of_ball(const engine::Body& body);

Extent extent_of(const engine::World& world);
/// Width of a sheet around a place that reaches twice as far as the scene [m].
double width_around(const Extent& extent, const Eigen::Vector3d& place);

}  // namespace constraint_sim
