#pragma once

#include <Eigen/Core>

#include "constraint_sim/engine/joint.h"
#include "engine/constraints/course.h"
#include "engine/model/mass_properties.h"

namespace constraint_sim::engine {

/// The frame of a joint on B, in B's frame. While a joint with axes is being closed its frame on B
/// goes home from where the rows held when that began: so the rows stay near the solution that is
/// meant, from any orientation, and no force acts at two places.
///   p(t) = p + s o,  F(t) = F exp([s ϑ]×),  s from 1 to 0
struct MovingFrame {
  Eigen::Vector3d anchor = Eigen::Vector3d::Zero();  ///< [m]
  Eigen::Matrix3d axes = Eigen::Matrix3d::Identity();
  bool moves = false;
  Eigen::Vector3d anchor_rate = Eigen::Vector3d::Zero();          ///< [m/s]
  Eigen::Vector3d anchor_acceleration = Eigen::Vector3d::Zero();  ///< [m/s²]
  Eigen::Vector3d spin = Eigen::Vector3d::Zero();                 ///< against B [rad/s]
  Eigen::Vector3d spin_rate = Eigen::Vector3d::Zero();            ///< [rad/s²]

  MovingFrame() = default;
  /// Home.
  MovingFrame(const Eigen::Vector3d& anchor_b, const Eigen::Matrix3d& frame_b)
      : anchor(anchor_b), axes(frame_b) {}
  /// A share `s` of the way from home to where it began: `shift` is o [m], `turn` ϑ [rad] in the
  /// joint's frame on B.
  MovingFrame(const Eigen::Vector3d& anchor_b, const Eigen::Matrix3d& frame_b,
              const Eigen::Vector3d& shift, const Eigen::Vector3d& turn, const Prescribed& s)
      : anchor(anchor_b + s.value * shift),
        axes(frame_b * rotation(s.value * turn).toRotationMatrix()),
        moves(true),
        anchor_rate(s.rate * shift),
        anchor_acceleration(s.acceleration * shift),
        spin(frame_b * (s.rate * turn)),
        spin_rate(frame_b * (s.acceleration * turn)) {}
};

}  // namespace constraint_sim::engine
