#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <cstdint>
#include <optional>

#include "constraint_sim/engine/world.h"
#include "ros/marker_set.h"
#include "ros/marker_style.h"

namespace constraint_sim {

/// Size of the sign of a joint with an axis. Changes only with edits. Lengths in m.
struct JointSize {
  double axis = 0.0;  ///< length of the smaller body, at most 0.3 m
  /// Distances along the axis from the joint to both ends of the smaller body.
  double before = 0.0, behind = 0.0;
  /// Radius of a gear's wheel, on body B or on A; 0 for a rack.
  double wheel = 0.0;
  bool wheel_is_on_a = false;
  bool touches = false;  ///< touches another wheel or a rack
  int teeth = 0;
  double tooth = 0.0;                              ///< distance between teeth
  Eigen::Vector3d rack = Eigen::Vector3d::Zero();  ///< axis to teeth, in the joint's frame on A
};
JointSize size_of(const engine::World& world, const engine::Joint& joint);
/// Sizes the wheels of a gear: two wheels that touch, or a wheel on a rack, where their places and
/// the ratio allow; else small wheels. Returns whether they touch.
bool find_wheels(const engine::World& world, const engine::Joint& gear, JointSize* first,
                 JointSize* second);

/// Returns whether the joint moves along its axis or plane, so that its anchors may be apart
/// without an error.
bool slides(engine::JointKind kind);
Eigen::Quaterniond orientation_of(const engine::World& world, const engine::Joint& joint);

/// Returns the marker type that draw_joint() needs.
std::int32_t type_of_sign(const engine::Joint& joint, const JointSize& size);
/// Draws the turning or sliding part between the anchors [m].
void draw_joint(const engine::World& world, const engine::Joint& joint, const JointSize& size,
                const Eigen::Vector3d& p_a, const Eigen::Vector3d& p_b, double most_width,
                ShownMarker* marker);
/// Draws the motor of a joint: an arc with an arrow head about the axis, or an arrow along the
/// axis.
void draw_motor(const engine::World& world, const engine::Joint& joint, const JointSize& size,
                const ShownMotor& motor, const Eigen::Vector3d& p_a, const Eigen::Vector3d& p_b,
                double most_width, ShownMarker* marker);
/// Returns the upper end of a sliding joint's rail [m]; for other joints the upper anchor.
double top_of_rail(const engine::World& world, const engine::Joint& joint, const JointSize& size,
                   const Eigen::Vector3d& p_a, const Eigen::Vector3d& p_b);
/// Returns the place of a label for the motor, or for the joint without one [m]: the upper end of
/// the axis, or the tip of the arrow.
Eigen::Vector3d end_of_sign(const engine::World& world, const engine::Joint& joint,
                            const JointSize& size, const std::optional<ShownMotor>& motor,
                            const Eigen::Vector3d& p_a, const Eigen::Vector3d& p_b,
                            const Eigen::Vector3d& up);

}  // namespace constraint_sim
