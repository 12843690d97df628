#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <cstdint>
#include <optional>

#include "constraint_sim/engine/world.h"
#include "ros/marker_set.h"
#include "ros/marker_style.h"

namespace constraint_sim {

/// How large the sign of a joint with an axis is; changes only with edits. Lengths in m.
struct JointSize {
  double axis = 0.0;  ///< as long as the smaller of its bodies, 0.3 m at most
  /// Along the axis to both ends of the smaller body, seen from the joint.
  double before = 0.0, behind = 0.0;
  /// Of a gear: the wheel on B, or on A, or the rack.
  double wheel = 0.0;
  bool wheel_is_on_a = false;
  bool touches = false;  ///< another wheel or a rack
  int teeth = 0;
  double tooth = 0.0;  ///< from one to the next
  Eigen::Vector3d rack =
      Eigen::Vector3d::Zero();  ///< from the axis to the teeth, in A's frame of the joint
};
JointSize size_of(const engine::World& world, const engine::Joint& joint);
/// What a gear couples is drawn as two wheels that touch, or as a wheel on its rack, where their
/// places and the ratio fit; else each as a small wheel. Whether they touch.
bool find_wheels(const engine::World& world, const engine::Joint& gear, JointSize* first,
                 JointSize* second);

/// Along its axis or its plane: then its anchors are apart without an error.
bool slides(engine::JointKind kind);
Eigen::Quaterniond orientation_of(const engine::World& world, const engine::Joint& joint);

/// The type of the marker that draw_joint() draws into.
std::int32_t type_of_sign(const engine::Joint& joint, const JointSize& size);
/// What turns or slides, where and along what, between these anchors [m].
void draw_joint(const engine::World& world, const engine::Joint& joint, const JointSize& size,
                const Eigen::Vector3d& p_a, const Eigen::Vector3d& p_b, double most_width,
                ShownMarker* marker);
/// The motor of a joint: about its axis at both ends, out of the bodies, or along it.
void draw_motor(const engine::World& world, const engine::Joint& joint, const JointSize& size,
                const ShownMotor& motor, const Eigen::Vector3d& p_a, const Eigen::Vector3d& p_b,
                double most_width, ShownMarker* marker);
/// The upper end of what slides along an axis [m]; of other joints the upper anchor.
double top_of_rail(const engine::World& world, const engine::Joint& joint, const JointSize& size,
                   const Eigen::Vector3d& p_a, const Eigen::Vector3d& p_b);
/// Where a label of that motor, or of the joint without one, is seen: the upper end of the axis, or
/// the tip of the arrow [m].
Eigen::Vector3d end_of_sign(const engine::World& world, const engine::Joint& joint,
                            const JointSize& size, const std::optional<ShownMotor>& motor,
                            const Eigen::Vector3d& p_a, const Eigen::Vector3d& p_b,
                            const Eigen::Vector3d& up);

}  // namespace constraint_sim
