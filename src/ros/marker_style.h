#pragma once

#include <ros/time.h>
#include <std_msgs/ColorRGBA.h>
#include <visualization_msgs/Marker.h>

#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <optional>
#include <string>

#include "constraint_sim/engine/world.h"

namespace constraint_sim {

/// What a constraint is drawn as. Of distance joints it is more than their kind.
enum class Look { kRod, kRope, kStrut, kSpring, kJoint, kCoupling };
Look look_of(const engine::Joint& joint);
/// Of a rope that hangs through: it pulls at nothing.
bool is_slack(const engine::Joint& joint, const engine::JointState& state);
/// The error that is shown [m]: none of a spring, whose length is free.
double shown_error(Look look, const engine::JointState& state);
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

/// Errors up to the first are green, from the second on red [m].
inline constexpr double kGreenError = 1e-6;
inline constexpr double kRedError = 1e-2;

/// About the centre of mass [m]; 0 of points and planes.
double radius_of(const engine::Shape& shape);

/// Type and size of the marker of a body; a plane is a sheet, half as opaque.
void set_shape(visualization_msgs::Marker* marker, const engine::Shape& shape);

std_msgs::ColorRGBA colour(double r, double g, double b, double a = 1.0);
std_msgs::ColorRGBA body_colour(const engine::Body& body);
/// Green without load, cyan in tension (share -1), yellow in compression (share 1), and over the
/// logarithm of the error to red.
std_msgs::ColorRGBA constraint_colour(double share, double error);
std_msgs::ColorRGBA motor_colour(bool saturated);
std_msgs::ColorRGBA friction_colour(bool sticks);

/// Along the surface, on A [N].
Eigen::Vector3d friction_of(const engine::Contact& contact);

/// The largest force of distance joints in the last seconds, beside which forces are drawn. It is
/// looked for ten times a second, and at every call until there is one.
class ForceScale {
 public:
  void update(const engine::World& world, const ros::Time& stamp);
  double reference() const { return reference_; }        ///< [N]
  double contact_reference() const { return contact_; }  ///< [N]
  /// The largest one where it slides, or sticks [N].
  double friction(bool sticks) const { return friction_[sticks ? 1 : 0]; }
  /// Of the reference, from -1 to 1.
  double share(double force) const;

 private:
  double reference_ = 0.0;
  double contact_ = 0.0;
  std::array<double, 2> friction_{};
  ros::Time stamp_;
};

/// Where a scene is and how large the signs in it are. Planes do not count.
struct Extent {
  Eigen::Vector3d low = Eigen::Vector3d::Zero(), high = Eigen::Vector3d::Zero();  ///< [m]
  double sign = 0.0;   ///< length of arrows [m]
  double width = 0.0;  ///< of lines, at most [m]
};
Extent extent_of(const engine::World& world);
/// Of a sheet around a place that reaches twice as far as the scene [m].
double width_around(const Extent& extent, const Eigen::Vector3d& place);

}  // namespace constraint_sim
