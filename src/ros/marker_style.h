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

/// What a constraint is drawn as. Of distance joints it is more than their kind.
enum class Look { kRod, kRope, kStrut, kSpring, kJoint, kCoupling };
Look look_of(const engine::Joint& joint);
/// Of a rope that hangs through: it pulls at nothing.
bool is_slack(const engine::Joint& joint, const engine::JointState& state);
/// The error that is shown [m]: none of a spring, whose length is free, and none of a motor on its
/// way to a position.
double shown_error(Look look, const engine::Joint& joint, const engine::JointState& state);
/// The force along the line that is drawn [N], > 0 pushes, where there is one.
std::optional<double> axial_force(const engine::Joint& joint, const engine::JointState& state);

/// A motor that drives a coordinate along or about the axis of its joint, or a distance.
struct ShownMotor {
  bool is_angle = false;  ///< turns about the axis; else moves along it
  double rate = 0.0;      ///< asked for [m/s or rad/s]
  double force = 0.0;     ///< of a motor by force, which has no rate [N or N m]
  double direction() const { return rate != 0.0 ? rate : force; }
};
std::optional<ShownMotor> shown_motor(const engine::Joint& joint, const engine::JointState& state);

inline constexpr double kNoForce = 1e-9;        ///< of the largest force: less is rounding
inline constexpr double kLeastLoad = 1e-3;      ///< of the largest one: less is shown as none
inline constexpr double kLeastFriction = 0.02;  ///< of the largest contact force: less is not drawn
inline constexpr double kFixedCube = 2.5;       ///< of the width of lines, where one is fixed
inline constexpr double kBrokenShown = 2.0;     ///< [s]
inline constexpr double kToldError = 1e-4;      ///< where constraints turn towards red [m]
inline constexpr double kRedError = 1e-2;       ///< from which on they are red [m]

/// About the centre of mass [m]; 0 of points and planes.
double radius_of(const engine::Shape& shape);

/// Half of what a shape covers along a direction of its own frame (unit) [m].
double half_width(const engine::Shape& shape, const Eigen::Vector3d& along);
/// Of a body in the world: the middle of its shape, and half of what it covers along a direction.
Eigen::Vector3d middle_of(const engine::Body& body, const engine::BodyState& state);
double half_width(const engine::Body& body, const engine::BodyState& state,
                  const Eigen::Vector3d& along);

/// Rods, ropes, springs and struts.
bool is_length(Look look);
/// Of a length: whether one end of it is fixed to the world, which is marked.
bool is_on_world(const engine::Joint& joint);
/// A body hides its arm to an anchor within its shape.
bool has_arm_outside(const engine::World& world, const engine::Joint& joint);

/// Type and size of the marker of a body; a plane is a sheet, half as opaque.
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
/// Green without load, cyan in tension, yellow in compression at any share of the largest force;
/// over the logarithm of the error to red.
std_msgs::ColorRGBA constraint_colour(double share, double error);
std_msgs::ColorRGBA motor_colour(bool saturated);
std_msgs::ColorRGBA friction_colour(bool sticks);
std_msgs::ColorRGBA slack_colour();
std_msgs::ColorRGBA broken_colour();
std_msgs::ColorRGBA fixed_colour();

/// Along the surface, on A [N].
Eigen::Vector3d friction_of(const engine::Contact& contact);

/// Friction that one arrow shows: of a contact that slides, or of all that stick between two
/// bodies, since only their sum is determined.
struct ShownFriction {
  const engine::Contact *first, *end;  ///< of the pair; those that slide have arrows of their own
  Eigen::Vector3d force;               ///< on A [N]
  bool sticks;
};

/// Contacts of a pair of bodies follow each other.
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

/// Where a scene is and how large the signs in it are. Planes do not count.
struct Extent {
  Eigen::Vector3d low = Eigen::Vector3d::Zero(), high = Eigen::Vector3d::Zero();  ///< [m]
  double sign = 0.0;   ///< length of arrows [m]
  double width = 0.0;  ///< of lines, at most [m]
  double diagonal() const { return (high - low).norm(); }
};

/// The largest forces in the last seconds, of distance joints and of contacts, beside which forces
/// are drawn. They are looked for ten times a second, and at every call until there are some.
class ForceScale {
 public:
  void update(const engine::World& world, const ros::Time& stamp);
  double reference() const { return axial_; }            ///< of distance joints [N]
  double contact_reference() const { return contact_; }  ///< [N]
  /// What is seen of its arrow [m].
  double contact_reach(const Extent& extent) const {
    return contact_length(extent) - (is_on_ball_ ? 0.0 : thickness_);
  }
  /// Of its arrow, which comes out of what it holds and would hide it [m].
  double contact_length(const Extent& extent) const {
    constexpr double kOut = 1.3;
    return std::max(extent.sign, kOut * thickness_);
  }
  /// Of the reference, from -1 to 1.
  double share(double force) const;

 private:
  double axial_ = 0.0, contact_ = 0.0;
  double thickness_ = 0.0;  // of the body that the largest contact force holds, along it [m]
  bool is_on_ball_ = false;
  ros::Time stamp_;
};

/// Unit.
Eigen::Vector3d down(const engine::World& world);

/// Of the force on A: that on the body that is held, which is the one that moves, else the upper
/// one.
double sign_of_held(const engine::World& world, const engine::Contact& contact,
                    const Eigen::Vector3d& down);

/// Of a ball, which hides what begins at its contact: arrows begin where they leave it; else 0 [m].
double radius_of_ball(const engine::Body& body);

Extent extent_of(const engine::World& world);
/// Of a sheet around a place that reaches twice as far as the scene [m].
double width_around(const Extent& extent, const Eigen::Vector3d& place);

}  // namespace constraint_sim
